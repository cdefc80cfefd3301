"""The phases of a docking, driven through by what is observed."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import pytest

from common.channels import DOCK_REQUEST
from common.channels import DRIVES as DRIVES_CHANNEL
from common.config import Config
from common.geometry import Pose2, features_at
from common.messages import Answer, ArmState, DockingState, DockRequest, Drives, LeaderState, LockRequest, Mission
from common.node import Inbox, NodeContext, Outbox
from common.timing import NS_PER_S, SteppedClock
from follower.supervisor.lateral_forecast import settled_sigma_m
from follower.supervisor.node import SupervisorNode
from follower.supervisor.observed import Decided, Observed
from follower.supervisor.sequence import DockingSequence
from follower.supervisor.standstill import Standstill
from tests.rigs.canbus_rig import CONFIG_PATH, stepped_config

STEP_NS = NS_PER_S // 20


def docking_state(config: Config, pose: Pose2, valid: bool = True) -> DockingState:
    filtered = tuple((float(a), float(b)) for a, b in features_at(config.leds.points, pose, config.camera.mount))
    return DockingState(
        1, 0, valid, "ok" if valid else "few_leds", 4, (None,) * 4, filtered if valid else (), None,
        pose.x_m, pose.y_m, pose.theta_rad, (0.0,) * 9, (0.0,) * 4, None, None, 0.1, 4, 1, 0,
    )  # fmt: skip


DRIVES = Drives(
    "disarmed", "", 0, 0, (0.0, 0.0), (0.0, 0.0), (0.0,) * 6, (0.0,) * 6, (0.0, 0.0), (0.0, 0.0), 0.2,
    True, 25.0, 0.0, 0.0, 0, 0, 0,
)  # fmt: skip
ARMS = ArmState(5.0, False, False, True, False)
LEADER = LeaderState(True, "", (1.0,) * 4, False, "down", "open", 0.0, 0)


@dataclass
class Bench:
    """A sequence with an obedient robot around it."""

    config: Config
    sequence: DockingSequence = field(init=False)
    seen: Observed = field(init=False)
    mission: Mission | None = None
    lock_requests: list[LockRequest] = field(default_factory=list)
    rolled_m: float = 0.0

    def __post_init__(self) -> None:
        self.sequence = DockingSequence(self.config, run_id=1000)
        far = docking_state(self.config, Pose2(5.0, 0.1, 0.0))
        self.seen = Observed(NS_PER_S, far, DRIVES, ARMS, LEADER, True)

    def step(self, **changes: Any) -> Decided:
        """Observe once with changes that stay."""
        self.seen = replace(self.seen, now_ns=self.seen.now_ns + STEP_NS, **changes)
        if self.seen.drives is not None:
            self.seen = replace(self.seen, drives=replace(self.seen.drives, measured_ns=self.seen.now_ns))
        decided = self.sequence.step(self.seen)
        self.seen = replace(self.seen, requests=(), lock_answers=())
        self.mission = decided.mission
        if decided.lock_request:
            self.lock_requests.append(decided.lock_request)
        drives = self.seen.drives
        if drives is not None and drives.state in ("disarmed", "armed"):
            state: Literal["armed", "disarmed"] = "armed" if decided.mission.armed else "disarmed"
            self.seen = replace(self.seen, drives=replace(drives, state=state, epoch=decided.mission.epoch))
        return decided

    def run(self, seconds: float, **changes: Any) -> str:
        """Observe for a while; the phase at the end."""
        self.step(**changes)
        for _ in range(round(seconds * 20) - 1):
            self.step()
        return self.sequence.phase

    def ask(self, action: Literal["start", "abort", "reset"], **kwargs: Any) -> Answer:
        """Send a request; its answer."""
        request = DockRequest(f"{action}-{self.seen.now_ns}", self.seen.now_ns + NS_PER_S, action, **kwargs)
        (answer,) = self.step(requests=(request,)).answers
        return answer

    def turn_while_searching(self) -> list[float]:
        """Let the base turn as told until the search is over; headings on the way."""
        headings = [0.0]
        track, radius = self.config.base.track_m, self.config.base.wheel_radius_m
        for _ in range(20 * 60):
            if self.sequence.phase != "search" or self.mission is None or self.seen.drives is None:
                break
            told = self.mission.turn_rate_rad_s if self.mission.motion == "turn" else 0.0
            headings.append(headings[-1] + told / 20)
            angle = headings[-1] * track / 2 / radius
            self.step(drives=replace(self.seen.drives, wheel_angle_rad=(-angle, angle)))
        return headings

    def roll(self, metres: float) -> Drives:
        """The drives after rolling that far since the insertion began."""
        angle = (self.rolled_m + metres) / self.config.base.wheel_radius_m
        assert self.seen.drives is not None
        return replace(self.seen.drives, wheel_angle_rad=(angle, angle))

    def to_approach(self) -> None:
        self.run(0.2)  # it stood before
        assert self.ask("start").outcome == "accepted"
        assert self.run(0.7) == "approach"

    def there(self, pose: Pose2) -> dict[str, Any]:
        """State and drives after a way that the odometry does not see: as after a jump of its encoders."""
        self.rolled_m += 5.0
        return {"state": docking_state(self.config, pose), "drives": self.roll(0.0)}

    def to_insert(self) -> None:
        self.to_approach()
        assert self.run(self.config.docking.settle_s + 0.2, **self.there(self.config.docking.goal(1))) == "insert"

    def to_push(self) -> None:
        self.to_insert()
        self.step()
        self.step(drives=self.roll(0.06), arms=replace(ARMS, contact=True))
        assert self.sequence.phase == "push"

    def to_lock(self) -> None:
        self.to_push()
        goal = self.config.docking.goal(1)
        docked = docking_state(self.config, Pose2(goal.x_m - 0.14, 0.0, 0.0))
        self.step(drives=self.roll(0.14), arms=replace(ARMS, contact=True, connected=True), state=docked)
        assert self.sequence.phase == "lock"


@pytest.fixture
def bench(config: Config) -> Bench:
    return Bench(config)


def test_a_docking_from_start_to_done(bench: Bench) -> None:
    bench.to_lock()
    bench.run(3.0)
    assert len(bench.lock_requests) >= 3
    assert {request.id for request in bench.lock_requests} == {bench.lock_requests[0].id}
    assert bench.run(0.1, leader=replace(LEADER, lock="locked")) == "lock"
    bench.step(lock_answers=(Answer(bench.lock_requests[0].id, "done", "locked"),))
    assert bench.sequence.phase == "release"
    assert bench.mission is not None
    assert bench.mission.grip == "open"
    assert bench.run(0.1, arms=ArmState(0.0, False, False, False, True)) == "retract"
    assert bench.mission.straight_speed_m_s < 0
    assert bench.run(0.1, drives=bench.roll(0.14)) == "retract"
    assert bench.run(0.1, drives=bench.roll(0.14 - 0.41)) == "done"
    assert not bench.mission.armed


def test_nothing_moves_before_start_and_each_docking_has_a_new_epoch(bench: Bench) -> None:
    assert bench.run(1.0) == "idle"
    assert bench.mission is not None
    assert (bench.mission.armed, bench.mission.motion) == (False, "hold")
    bench.to_approach()
    first = bench.mission.epoch
    bench.ask("abort")
    bench.ask("reset")
    bench.to_approach()
    assert bench.mission.epoch > first


@pytest.mark.parametrize(
    ("missing", "named"),
    [
        ({"state": None}, "no docking state"),
        ({"controller_alive": False}, "controller silent"),
        ({"arms": None}, "arms silent"),
        ({"drives": None}, "no drives"),
        ({"leader": replace(LEADER, lock="locked")}, "the Leader's lock is locked"),
        (
            {"leader": replace(LEADER, lock="fault", cause="switch lost")},
            "the Leader's lock has a fault: switch lost",
        ),
    ],
)
def test_what_keeps_it_from_arming_is_named(bench: Bench, missing: dict[str, object], named: str) -> None:
    bench.ask("start")
    assert bench.run(6.0, **missing) == "aborted"
    assert bench.mission is not None
    assert bench.mission.cause.startswith("acquire_timeout")
    assert named in bench.mission.cause
    assert not bench.mission.armed


@pytest.mark.parametrize(
    ("leader_heard", "seen_as", "cause"),
    [
        (True, "few_leds", "leds_lost: too near for a search"),
        (False, "few_leds", "leader_lost: too near for a search"),
        (True, "no_frame", "camera_silent: no_frame"),
    ],
)
def test_what_hides_the_leds_where_no_search_may_begin_is_named(
    bench: Bench, config: Config, leader_heard: bool, seen_as: Any, cause: str
) -> None:
    near = Pose2(config.docking.goal(1).x_m + 0.3, 0, 0)
    bench.run(0.1, state=docking_state(config, near))
    blind = replace(docking_state(config, near, valid=False), cause=seen_as)
    bench.seen = replace(bench.seen, state=blind, leader=LEADER if leader_heard else None)
    bench.ask("start")
    assert bench.run(6.0) == "aborted"
    assert bench.mission is not None
    assert (bench.mission.cause, bench.mission.armed) == (cause, False)


def test_invisible_leds_are_searched_for_then_named(bench: Bench, config: Config) -> None:
    bench.ask("start")
    assert bench.run(4.0, state=docking_state(config, Pose2(5, 0, 0), valid=False)) == "search"
    assert bench.mission is not None
    assert (bench.mission.motion, bench.mission.v_max_m_s) == ("turn", 0.0)
    angles = bench.turn_while_searching()
    assert bench.sequence.phase == "aborted"
    assert bench.mission.cause == "leds_lost: 3 searches"
    assert max(map(abs, angles)) < math.radians(config.supervisor.search_turn_deg) + 0.05


def test_a_search_that_finds_the_leds_goes_on(bench: Bench, config: Config) -> None:
    bench.to_approach()
    seen = bench.seen.state
    assert bench.run(3.5, state=docking_state(config, Pose2(5, 0, 0), valid=False)) == "search"
    assert bench.mission is not None
    epoch = bench.mission.epoch
    assert bench.run(0.4, state=seen) == "search"
    assert bench.mission.motion == "hold"
    assert bench.run(1.0) == "approach"
    assert bench.mission.epoch == epoch


def test_a_search_arms_at_standstill_only(bench: Bench, config: Config) -> None:
    bench.run(0.2, state=docking_state(config, Pose2(5.0, 0.0, 0.0), valid=False))
    assert bench.ask("start").outcome == "accepted"
    while bench.sequence.phase == "acquire":
        bench.step()
    assert bench.sequence.phase == "search"
    for _ in range(20):
        bench.rolled_m += 0.005
        bench.step(drives=bench.roll(0.0))
        assert bench.mission is not None
        assert not bench.mission.armed
    bench.run(1.0)
    assert bench.mission is not None
    assert bench.mission.armed


def test_near_the_queue_nothing_is_searched(bench: Bench, config: Config) -> None:
    bench.to_approach()
    near = Pose2(config.docking.goal(1).x_m + 0.4, 0.0, 0.0)
    bench.step(**bench.there(near))
    assert bench.run(4.0, state=docking_state(config, near, valid=False)) == "aborted"
    assert bench.mission is not None
    assert bench.mission.cause == "leds_lost: too near for a search"


def test_an_invalid_state_pauses_and_half_a_second_of_valid_ones_resumes_in_place(
    bench: Bench, config: Config
) -> None:
    bench.to_approach()
    valid = bench.seen.state
    assert bench.mission is not None
    epoch = bench.mission.epoch
    bench.step(state=docking_state(config, Pose2(5, 0, 0), valid=False))
    assert (bench.mission.motion, bench.mission.armed) == ("hold", True)
    assert "few_leds" in bench.mission.waiting
    bench.run(0.5, state=valid)
    assert bench.mission.motion == "hold"
    bench.run(0.1)
    assert (bench.mission.motion, bench.mission.epoch) == ("servo", epoch)


def test_wheels_that_slip_pause_until_they_stand(bench: Bench) -> None:
    bench.to_approach()
    state, drives = bench.seen.state, bench.seen.drives
    assert bench.mission is not None
    assert state is not None
    assert drives is not None
    rolling = replace(drives, wheel_speed_rad_s=(2.0, 2.0))
    half = replace(state, disturbance=(-0.45, 0.0, 0.0, 0.0))
    bench.run(1.0, drives=rolling, state=half)
    assert bench.mission.motion == "servo"
    bench.run(0.3, state=replace(state, disturbance=(-0.6, 0.0, 0.0, 0.0)))
    assert bench.mission.motion == "servo"
    bench.step()
    assert (bench.mission.motion, bench.mission.armed, bench.mission.waiting) == ("hold", True, "the wheels slip")
    bench.run(0.6, drives=drives)
    assert bench.mission.motion == "servo"
    waiting = [bench.step(drives=replace(rolling, measured_ns=0)).mission.waiting for _ in range(23)]
    # the estimator has time to learn that it is over
    assert 18 <= waiting.index("the wheels slip") <= 21


def test_an_undervoltage_pauses_until_it_is_over(bench: Bench) -> None:
    bench.to_approach()
    assert bench.mission is not None
    assert bench.seen.drives is not None
    bench.step(drives=replace(bench.seen.drives, battery_v=21.9))
    assert (bench.mission.motion, bench.mission.armed) == ("hold", True)
    assert bench.mission.waiting == "battery at 21.9 V, below 22 V (base.battery_min_v)"
    bench.run(0.7, drives=replace(bench.seen.drives, battery_v=22.0))
    assert bench.mission.motion == "servo"


def test_with_an_undervoltage_nothing_is_armed(bench: Bench) -> None:
    bench.seen = replace(bench.seen, drives=replace(DRIVES, battery_v=21.9))
    assert bench.ask("start").outcome == "accepted"
    for _ in range(40):
        mission = bench.step().mission
        assert not mission.armed
    assert "battery at 21.9 V" in mission.waiting


def test_with_an_undervoltage_the_process_refuses_to_begin(tmp_path: Path) -> None:
    config = stepped_config()
    node = SupervisorNode(NodeContext(config, CONFIG_PATH, tmp_path, 1, SteppedClock(NS_PER_S)))
    inbox, sender = Inbox("stepped"), Outbox("test", 1, "stepped")
    request = DockRequest("start-1", 2 * NS_PER_S, "start")
    empty = replace(DRIVES, battery_v=21.9, measured_ns=NS_PER_S)
    inbox.put_state(DRIVES_CHANNEL, sender.pack(DRIVES_CHANNEL, empty, NS_PER_S), NS_PER_S)
    inbox.put_queued(DOCK_REQUEST, inbox.decode(DOCK_REQUEST, sender.pack(DOCK_REQUEST, request, NS_PER_S), NS_PER_S))
    inbox.begin_step()
    outputs = node.step(NS_PER_S, inbox)
    node.stop(NS_PER_S)
    answers = [message for _, message in outputs if isinstance(message, Answer)]
    assert [(answer.outcome, answer.reason.partition(",")[0]) for answer in answers] == [
        ("refused", "battery at 21.9 V")
    ]


def test_a_lock_that_cannot_be_the_leader_does_not_resume(bench: Bench, config: Config) -> None:
    bench.to_approach()
    bench.step(state=docking_state(config, Pose2(5, 0, 0), valid=False))
    assert bench.run(2.0, state=docking_state(config, Pose2(5.0, 1.5, 0.0))) == "approach"
    assert bench.mission is not None
    assert bench.mission.motion == "hold"
    assert bench.run(2.0) == "aborted"
    assert bench.mission.cause.startswith("lock_disagrees")


def test_the_sixth_pause_ends_it(bench: Bench, config: Config) -> None:
    bench.to_approach()
    valid = bench.seen.state
    for _ in range(5):
        bench.step(state=docking_state(config, Pose2(5, 0, 0), valid=False))
        assert bench.run(0.7, state=valid) == "approach"
    bench.step(state=docking_state(config, Pose2(5, 0, 0), valid=False))
    assert bench.mission is not None
    assert (bench.sequence.phase, bench.mission.cause.partition(":")[0]) == ("aborted", "too_many_pauses")


@pytest.mark.parametrize(
    ("lost", "leader", "cause"),
    [("state", LEADER, "estimator_silent"), ("leds", None, "leader_lost"), ("frame", LEADER, "camera_silent")],
)
def test_what_is_lost_for_too_long_is_named(
    bench: Bench, config: Config, lost: str, leader: LeaderState | None, cause: str
) -> None:
    bench.to_approach()
    state = None if lost == "state" else docking_state(config, Pose2(5, 0, 0), valid=False)
    if lost == "frame" and state is not None:
        state = replace(state, cause="no_frame")
    assert bench.run(3.5, state=state, leader=leader) in ("aborted", "search")
    bench.turn_while_searching()
    assert bench.mission is not None
    assert bench.mission.cause.startswith(cause)


def test_without_one_led_it_goes_on_slowly_and_without_two_it_pauses(bench: Bench, config: Config) -> None:
    bench.to_approach()
    assert bench.seen.state is not None
    whole = ((0.0, 0.0),) * 4
    bench.run(0.2, state=replace(bench.seen.state, features=whole))
    assert bench.mission is not None
    assert bench.mission.v_max_m_s == config.supervisor.approach_speed_m_s
    bench.run(0.5, state=replace(bench.seen.state, features=(*whole[:3], None), leds_seen=3))
    assert (bench.mission.motion, bench.mission.v_max_m_s) == ("servo", config.supervisor.reduced_speed_m_s)
    bench.run(0.5, state=replace(bench.seen.state, features=(*whole[:2], None, None), leds_seen=2))
    assert (bench.mission.motion, bench.mission.armed) == ("hold", True)


def test_three_leds_tell_the_goal_less_well_than_four(config: Config) -> None:
    goal = config.docking.goal(1)
    four = settled_sigma_m(config, goal, ())
    three = [settled_sigma_m(config, goal, (led,)) for led in range(4)]
    assert 0.0 < four < min(three)
    assert settled_sigma_m(config, goal, (0, 1)) == math.inf


def test_the_last_metre_is_slow(bench: Bench, config: Config) -> None:
    bench.to_approach()
    assert bench.mission is not None
    assert bench.mission.v_max_m_s == config.supervisor.approach_speed_m_s
    bench.step(**bench.there(Pose2(2.4, 0.1, 0.0)))
    assert bench.mission.v_max_m_s == config.supervisor.last_metre_speed_m_s


def test_on_the_way_to_the_last_metre_the_cap_falls_no_faster_than_the_controller_slows(
    bench: Bench, config: Config
) -> None:
    bench.to_approach()
    goal_m = config.docking.goal(1).x_m
    caps, x_m = [], goal_m + 2.2
    while x_m > goal_m + 0.9:
        bench.step(**bench.there(Pose2(x_m, 0.0, 0.0)))
        assert bench.mission is not None
        caps.append(bench.mission.v_max_m_s)
        x_m -= caps[-1] * config.controller.period_ms / 1000
    assert (caps[0], caps[-1]) == (config.supervisor.approach_speed_m_s, config.supervisor.last_metre_speed_m_s)
    assert max(a - b for a, b in pairwise(caps)) <= config.controller.realtime.rate_limit[0]


@pytest.mark.parametrize("off", [Pose2(1.5, 0.05, 0.0), Pose2(1.5, 0.0, 0.03), Pose2(1.62, 0.0, 0.0)])
def test_it_does_not_push_while_off_the_goal(bench: Bench, off: Pose2) -> None:
    bench.to_approach()
    assert bench.run(2.0, **bench.there(off)) == "approach"


@pytest.mark.parametrize(
    ("changes", "cause"),
    [
        ({"stop_inputs_clear": False}, "stop_input"),
        ({"state": "fault", "cause": "node 1: EMCY 0x3210"}, "drive_fault: node 1: EMCY 0x3210"),
        ({"state": "stopped", "cause": "second_writer"}, "gate_stop: second_writer"),
        ({"state": "disarmed"}, "drives_disarmed: by themselves"),
        ({"epoch": 7}, "drives_disarmed: by themselves"),
    ],
)
def test_the_drives_can_end_a_docking_in_any_phase(config: Config, changes: dict[str, Any], cause: str) -> None:
    for phase in ("to_approach", "to_push", "to_lock"):
        bench = Bench(config)
        getattr(bench, phase)()
        assert bench.seen.drives is not None
        bench.step(drives=replace(bench.seen.drives, **changes))
        assert bench.mission is not None
        assert (bench.sequence.phase, bench.mission.cause) == ("aborted", cause)
        assert (bench.mission.armed, bench.mission.grip) == (False, "closed")


def test_a_late_command_stops_and_the_approach_goes_on_under_a_new_epoch(bench: Bench) -> None:
    bench.to_approach()
    assert bench.mission is not None
    for number in range(4):
        epoch = bench.mission.epoch
        assert bench.seen.drives is not None
        bench.step(drives=replace(bench.seen.drives, state="stopped", cause="command_age"))
        assert not bench.mission.armed
        if number < 3:
            assert (bench.sequence.phase, bench.mission.epoch) == ("acquire", epoch + 1)
            assert bench.run(0.8, drives=replace(bench.seen.drives, state="disarmed", cause="")) == "approach"
    assert bench.mission.cause == "gate_stop: command_age"


def test_nothing_is_armed_anew_while_the_robot_still_rolls(bench: Bench) -> None:
    bench.to_approach()
    drives = bench.seen.drives
    assert drives is not None
    bench.step(drives=replace(drives, state="stopped", cause="status_age"))
    for _ in range(40):
        bench.rolled_m += 0.005
        bench.step(drives=replace(bench.roll(0.0), state="disarmed"))
        assert bench.mission is not None
        assert (bench.sequence.phase, bench.mission.armed) == ("acquire", False)
        assert bench.mission.waiting == "standstill"
    assert bench.run(0.9) == "approach"


def test_wheels_whose_speed_reads_noise_at_rest_stand(bench: Bench) -> None:
    noise = random.Random(1)
    bench.run(0.2)
    assert bench.ask("start").outcome == "accepted"
    for _ in range(15):
        drives = bench.seen.drives
        assert drives is not None
        bench.step(drives=replace(drives, wheel_speed_rad_s=(noise.gauss(0.0, 0.2), noise.gauss(0.0, 0.2))))
    assert bench.sequence.phase == "approach"


@pytest.mark.parametrize("hundredths_s", [18, 19, 20, 21, 500])
def test_it_stands_once_it_has_stood_for_a_fifth_of_a_second(config: Config, hundredths_s: int) -> None:
    standstill = Standstill(config.base)
    for n in range(hundredths_s + 1):
        now_ns = n * NS_PER_S // 100
        standstill.step(now_ns, replace(DRIVES, measured_ns=now_ns, wheel_angle_rad=(3.0, 3.0 + n * 1e-5)))
    assert standstill.holds == (hundredths_s >= 20)


def test_it_stands_over_a_step_that_is_not_heard_not_over_a_measurement_that_stays(config: Config) -> None:
    standstill = Standstill(config.base)
    for n in range(0, 300, 50):
        heard = replace(DRIVES, measured_ns=n * NS_PER_S // 1000, wheel_angle_rad=(3.0, 3.0))
        standstill.step(n * NS_PER_S // 1000, heard if n % 100 == 50 else None)
    assert standstill.holds
    standstill.step(350 * NS_PER_S // 1000, heard)
    assert standstill.holds
    standstill.step(351 * NS_PER_S // 1000, heard)
    assert not standstill.holds
    for n, turned_rad in ((355, 0.0), (360, 0.1), (365, 0.0)):
        now_ns = n * NS_PER_S // 1000
        standstill.step(now_ns, replace(DRIVES, measured_ns=now_ns, wheel_angle_rad=(3.0 + turned_rad, 3.0)))
    assert not standstill.holds


def test_who_is_late_now_and_then_only_does_not_end_the_docking(bench: Bench) -> None:
    bench.to_approach()
    for _ in range(6):
        assert bench.seen.drives is not None
        bench.step(drives=replace(bench.seen.drives, state="stopped", cause="status_age"))
        assert bench.sequence.phase == "acquire"
        assert bench.run(7.0, drives=replace(bench.seen.drives, state="disarmed", cause="")) == "approach"
    assert bench.sequence.attempt.rearmed == 6


def test_a_stop_input_that_is_told_once_the_drives_are_heard_again_ends_it(bench: Bench) -> None:
    bench.to_approach()
    drives = bench.seen.drives
    assert drives is not None
    bench.step(drives=replace(drives, state="stopped", cause="status_age", stop_inputs_clear=False))
    assert bench.sequence.phase == "acquire"
    bench.step(drives=replace(drives, state="disarmed", stop_inputs_clear=False))
    assert bench.mission is not None
    assert (bench.sequence.phase, bench.mission.cause) == ("aborted", "stop_input")


def test_after_a_stall_of_the_machine_the_approach_goes_on(bench: Bench) -> None:
    """Everybody stood still: the supervisor looks before the bridge speaks again, and that has stopped by name."""
    bench.to_approach()
    drives = bench.seen.drives
    assert drives is not None
    bench.seen = replace(bench.seen, now_ns=bench.seen.now_ns + 2 * NS_PER_S)
    bench.step(drives=None)
    bench.step(drives=replace(drives, state="stopped", cause="bridge_stalled"))
    assert bench.sequence.phase == "acquire"
    bench.seen = replace(bench.seen, drives=replace(drives, state="disarmed"))
    assert bench.run(1.0) == "approach"


@pytest.mark.parametrize("cause", ["node_silent: left wheel: node 1 is silent", "bad_frames: CAN bus: 3 frames"])
def test_what_passes_on_the_bus_stops_it_until_it_is_over(bench: Bench, cause: str) -> None:
    """SAFETY.md, rows 21 and 23: S1. The stop inputs are silent with the whole bus; that is no pressed button."""
    bench.to_approach()
    drives = bench.seen.drives
    assert drives is not None
    bench.step(drives=replace(drives, state="stopped", cause=cause, stop_inputs_clear=cause.startswith("bad")))
    assert bench.run(2.0) == "acquire"
    assert bench.mission is not None
    assert (bench.mission.armed, bench.mission.waiting) == (False, cause)
    assert bench.run(0.8, drives=replace(drives, state="disarmed", cause="")) == "approach"


def test_in_contact_a_late_command_ends_the_docking(bench: Bench) -> None:
    bench.to_push()
    assert bench.seen.drives is not None
    bench.step(drives=replace(bench.seen.drives, state="stopped", cause="command_age"))
    assert bench.mission is not None
    assert (bench.sequence.phase, bench.mission.grip) == ("aborted", "closed")


def test_what_ends_in_contact_waits_for_a_person(bench: Bench) -> None:
    bench.to_push()
    assert bench.ask("abort").outcome == "done"
    assert bench.mission is not None
    assert (bench.mission.cause, bench.mission.needs_reset) == ("operator_abort", True)
    assert "reset first" in bench.ask("start").reason
    assert bench.ask("reset").outcome == "done"
    assert bench.ask("start").outcome == "accepted"


def test_what_touches_the_queue_does_so_over_a_reset_until_it_is_let_go(bench: Bench) -> None:
    bench.to_push()
    near = docking_state(bench.config, Pose2(bench.config.docking.goal(1).x_m - 0.06, 0.0, 0.0))
    bench.step(state=near)
    assert bench.ask("abort").outcome == "done"
    assert bench.ask("reset").outcome == "done"
    assert bench.step().summary.in_contact
    assert bench.ask("start").outcome == "accepted"
    assert bench.step().summary.in_contact
    assert bench.ask("abort").outcome == "done"
    assert bench.mission is not None
    assert bench.mission.needs_reset
    assert bench.ask("reset").outcome == "done"
    assert not bench.step(arms=replace(ARMS, gripped=False, released=True)).summary.in_contact
    # taken again where it stood
    assert bench.step(arms=ARMS).summary.in_contact


def test_a_count_that_is_too_low_does_not_end_contact(bench: Bench) -> None:
    goal_m = bench.config.docking.goal(5).x_m
    away = docking_state(bench.config, Pose2(goal_m + 2.0, 0.0, 0.0))
    bench.run(0.2, state=away, leader=replace(LEADER, lock="locked", queue=4))
    assert bench.ask("start", trolley=5).outcome == "accepted"
    assert bench.run(0.7) == "approach"
    there = Pose2(goal_m, 0.0, 0.0)
    assert bench.run(bench.config.docking.settle_s + 0.2, **bench.there(there)) == "insert"
    bench.step()
    assert bench.ask("abort").outcome == "done"
    assert bench.step(leader=replace(LEADER, lock="locked", queue=1)).summary.in_contact
    assert not bench.step(state=away, drives=bench.roll(-2.0)).summary.in_contact


def test_after_a_start_a_gripped_trolley_may_touch_the_queue_until_it_is_seen_clear_of_it(config: Config) -> None:
    bench = Bench(config)
    far, near = (docking_state(config, Pose2(config.docking.goal(2).x_m + away, 0.0, 0.0)) for away in (1.0, 0.1))
    queue_of_one = replace(LEADER, lock="locked", queue=1)
    assert bench.step(state=near, leader=queue_of_one).summary.in_contact
    assert bench.step(state=far, leader=None).summary.in_contact
    assert bench.step(leader=replace(queue_of_one, queue=None)).summary.in_contact
    assert not bench.step(leader=queue_of_one).summary.in_contact


def test_silent_drives_abort(bench: Bench) -> None:
    bench.to_approach()
    assert bench.run(0.4, drives=None) == "aborted"


def test_a_push_without_contact_ends_at_its_limit(bench: Bench, config: Config) -> None:
    bench.to_push()
    bench.step()
    assert bench.run(0.1, drives=bench.roll(config.supervisor.push_limit_m + 0.01)) == "aborted"
    assert bench.mission is not None
    assert bench.mission.cause == "no_contact"


def test_a_push_that_does_not_move_ends_in_time(bench: Bench) -> None:
    bench.to_push()
    assert bench.run(15.0) == "aborted"
    assert bench.mission is not None
    assert bench.mission.cause == "push_timeout"


def test_a_trolley_that_stands_fast_before_the_lock_is_early_contact(bench: Bench) -> None:
    bench.to_push()
    bench.step()
    assert bench.run(0.1, drives=bench.roll(0.14), arms=replace(ARMS, contact=True)) == "push"
    assert bench.run(0.1, drives=bench.roll(0.05), arms=replace(ARMS, contact=True, connected=True)) == "aborted"
    assert bench.mission is not None
    assert bench.mission.cause == "contact_early"


@pytest.mark.parametrize(("short_m", "phase"), [(0.01, "lock"), (0.05, "aborted")])
def test_a_trolley_that_is_rigid_before_its_place_is_not_docked(bench: Bench, short_m: float, phase: str) -> None:
    bench.to_push()
    docking = bench.config.docking
    ended = Pose2(docking.goal(1).x_m - docking.push_stroke_m + short_m, 0.0, 0.0)
    connected = replace(ARMS, contact=True, connected=True)
    bench.step(drives=bench.roll(0.14), arms=connected, state=docking_state(bench.config, ended))
    assert bench.sequence.phase == phase
    assert bench.mission is not None
    assert bench.mission.cause == ("" if phase == "lock" else "contact_elsewhere")


def test_a_refused_lock_and_a_silent_leader_end_by_name_without_letting_go(config: Config) -> None:
    bench = Bench(config)
    bench.to_lock()
    bench.step()
    refused = Answer(bench.lock_requests[0].id, "refused", "no beam in the guide")
    bench.step(lock_answers=(refused,))
    assert bench.mission is not None
    assert bench.mission.cause == "lock_refused: no beam in the guide"
    other = Bench(config)
    other.to_lock()
    assert other.run(29.0, leader=None) == "lock"
    assert other.mission is not None
    assert (other.mission.armed, other.mission.motion) == (True, "hold")
    assert other.mission.waiting == "the Leader's link"
    assert other.run(2.0) == "aborted"
    assert (other.mission.cause, other.mission.grip) == ("leader_silent", "closed")


def test_the_lock_step_goes_on_when_the_link_returns(bench: Bench) -> None:
    bench.to_lock()
    bench.run(20.0, leader=None)
    bench.run(2.0, leader=replace(LEADER, lock="locked"))
    bench.step(lock_answers=(Answer(bench.lock_requests[0].id, "done", "locked"),))
    assert bench.sequence.phase == "release"


def test_requests_that_make_no_sense_are_refused_and_old_ones_expire(bench: Bench) -> None:
    bench.to_approach()
    assert bench.ask("start").outcome == "refused"
    assert bench.ask("reset").outcome == "refused"
    old = DockRequest("old", 1, "abort")
    (answer,) = bench.step(requests=(old,)).answers
    assert (answer.outcome, bench.sequence.phase) == ("expired", "approach")
    assert bench.ask("abort").outcome == "done"
    assert bench.sequence.phase == "aborted"
