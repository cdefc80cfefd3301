"""Moving the robot by hand: when it is armed, when it ends, and that it goes through the gate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from common.channels import COMMAND, DOCK_REQUEST, DRIVES, MANUAL_REQUEST, MISSION
from common.config import Config
from common.messages import (
    Answer,
    ArmState,
    Command,
    DockRequest,
    Drives,
    ManualRequest,
    Mission,
    seal_command,
)
from common.node import Inbox, Node, NodeContext, Output, Trigger
from common.processes import process
from common.timing import NS_PER_MS, NS_PER_S, SteppedClock
from follower.supervisor.manual import ManualMode, ManualSeen, ManualStep
from sim.stepped import SteppedExecutor
from station.operate.manual import Fingers, Keys, ManualFeedback
from tests.rigs.canbus_rig import CONFIG_PATH, stepped_config
from tests.unit.follower.supervisor.test_sequence import ARMS, Bench
from tests.unit.follower.supervisor.test_sequence import DRIVES as DISARMED

STEP_NS = NS_PER_S // 20


class Hand:
    """A manual mode beside an idle docking, and a station whose commands stay fresh."""

    def __init__(self, config: Config) -> None:
        docking = Bench(config)
        self.idle = docking.step().mission
        self.mode = ManualMode(config, run_id=77)
        self.seen = ManualSeen(NS_PER_S, "idle", DISARMED, ARMS, None)

    def step(self, **changes: Any) -> ManualStep:
        self.seen = replace(self.seen, now_ns=self.seen.now_ns + STEP_NS, **changes)
        step = self.mode.step(self.seen)
        self.seen = replace(self.seen, requests=(), dock_requests=())
        return step

    def ask(self, action: Any = "start", **fields: Any) -> Answer:
        request = ManualRequest(f"m-{self.seen.now_ns}", self.seen.now_ns + NS_PER_S, action, **fields)
        (answer,) = self.step(requests=(request,)).answers
        return answer

    @property
    def mission(self) -> Mission:
        return self.mode.mission(self.idle)

    def command(self, epoch: int) -> Command:
        return seal_command(Command(0.05, 0.0, epoch, 1, 1, 1, 1, 1))

    def under_way(self) -> int:
        assert self.ask().outcome == "accepted"
        epoch = self.mission.epoch
        self.step(command=self.command(epoch), drives=replace(DISARMED, state="armed", epoch=epoch))
        assert self.mode.active
        return epoch


@pytest.fixture
def hand(config: Config) -> Hand:
    return Hand(config)


def test_it_arms_an_epoch_of_its_own_with_low_caps(hand: Hand) -> None:
    assert hand.mission == hand.idle
    assert hand.ask(grip="open", lift_m=0.1).outcome == "accepted"
    mission = hand.mission
    assert (mission.phase, mission.armed, mission.motion, mission.contact_expected) == ("manual", True, "hold", False)
    assert (mission.grip, mission.lift_m) == ("open", 0.1)
    assert (mission.v_max_m_s, mission.w_max_rad_s) == (0.10, 0.30)
    assert mission.epoch > 1 << 62
    first = mission.epoch
    assert hand.ask("stop").outcome == "done"
    assert hand.mission == hand.idle
    hand.ask()
    assert hand.mission.epoch == first + 1


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"phase": "approach"}, "a docking is under way: phase approach"),
        ({"phase": "aborted"}, "the last docking was aborted: reset it first"),
        ({"drives": None}, "the CAN bridge is silent"),
        ({"arms": None}, "the arms' process is silent"),
        ({"drives": replace(DISARMED, stop_inputs_clear=False)}, "a stop input is active"),
        ({"drives": replace(DISARMED, state="fault", cause="left wheel: hot")}, "drives: left wheel: hot"),
        ({"drives": replace(DISARMED, battery_v=21.9)}, "battery at 21.9 V, below 22 V (base.battery_min_v)"),
    ],
)
def test_it_refuses_with_one_line(hand: Hand, changes: dict[str, Any], reason: str) -> None:
    hand.seen = replace(hand.seen, **changes)
    answer = hand.ask()
    assert (answer.outcome, answer.reason) == ("refused", reason)
    assert not hand.mode.active


def test_it_refuses_a_height_beyond_the_lifts_travel(hand: Hand) -> None:
    answer = hand.ask(lift_m=0.501)
    assert (answer.outcome, answer.reason) == ("refused", "the lift goes up to 500 mm (follower_can.lift_max_m)")
    assert hand.ask(lift_m=0.5).outcome == "accepted"


def test_an_expired_request_and_a_second_station_arm_nothing(hand: Hand) -> None:
    old = ManualRequest("old", hand.seen.now_ns - 1, "start")
    assert hand.step(requests=(old,)).answers[0].outcome == "expired"
    assert not hand.mode.active
    epoch = hand.under_way()
    second = hand.ask()
    assert (second.outcome, second.reason) == ("refused", "another station has the manual mode")
    assert hand.mission.epoch == epoch


@pytest.mark.parametrize(
    ("changes", "cause"),
    [
        ({"command": None}, "manual: station_silent"),
        ({"drives": None}, "manual: drives_silent"),
        ({"stop_inputs_clear": False}, "manual: stop_input"),
        ({"state": "stopped", "cause": "command_age"}, "manual: gate_stop: command_age"),
        ({"state": "fault", "cause": "bus lost"}, "manual: gate_stop: bus lost"),
        ({"arms": ArmState(0.0, False, False, True, False, "collision")}, "manual: collision"),
    ],
)
def test_it_ends_by_name(hand: Hand, changes: dict[str, Any], cause: str) -> None:
    hand.under_way()
    assert hand.seen.drives is not None
    known = {"command", "drives", "arms"}
    fields = {key: value for key, value in changes.items() if key in known}
    if not fields:
        fields = {"drives": replace(hand.seen.drives, **changes)}
    for _ in range(8):
        hand.step(**fields)
    assert not hand.mode.active
    assert (hand.mission.armed, hand.mission.cause) == (False, cause)


def test_commands_of_another_epoch_do_not_hold_it(hand: Hand) -> None:
    epoch = hand.under_way()
    for _ in range(5):
        hand.step(command=hand.command(epoch - 1))
    assert not hand.mode.active


def test_what_the_arms_felt_in_an_earlier_epoch_does_not_end_it(hand: Hand) -> None:
    hand.seen = replace(hand.seen, arms=ArmState(0.0, False, False, True, False, "slip"))
    assert hand.ask().outcome == "accepted"
    assert hand.mode.active


def test_no_docking_begins_meanwhile_and_an_abort_ends_it(hand: Hand) -> None:
    hand.under_way()
    start = DockRequest("d1", hand.seen.now_ns + NS_PER_S, "start")
    step = hand.step(dock_requests=(start,))
    assert (step.dock_requests, step.dock_answers[0].outcome) == ((), "refused")
    step = hand.step(dock_requests=(replace(start, action="abort"),))
    assert step.dock_answers[0].outcome == "done"
    assert not hand.mode.active
    assert hand.step(dock_requests=(start,)).dock_requests == (start,)


class Operator(Node):
    """A station in stepped time: asks, commands while ``until_ns`` has not come, then dies without a word."""

    name = "operator"
    inputs = (MISSION, DRIVES)
    outputs = (COMMAND, MANUAL_REQUEST, DOCK_REQUEST)
    trigger = Trigger(period_ns=NS_PER_S // 50)

    def __init__(self, twist: tuple[float, float], until_ns: int, **fields: Any) -> None:
        self.twist, self.until_ns, self.fields = twist, until_ns, fields
        self.missions: list[Mission] = []
        self.drives: list[Drives] = []
        self._sequence = 0

    def step(self, now_ns: int, inputs: Inbox) -> Sequence[Output]:
        drives, mission = inputs.fresh(DRIVES, now_ns), inputs.fresh(MISSION, now_ns)
        if drives is None or mission is None:
            return ()
        self.drives.append(drives)
        self.missions.append(mission)
        self._sequence += 1
        if self._sequence == 1:
            return ((MANUAL_REQUEST, ManualRequest("by-hand", now_ns + NS_PER_S, "start", **self.fields)),)
        if mission.phase != "manual" or now_ns >= self.until_ns:
            return ()
        told = Command(*self.twist, mission.epoch, self._sequence, now_ns, now_ns + 100 * NS_PER_MS, 0, now_ns)
        return ((COMMAND, seal_command(told)),)


def by_hand(runtime: Path, operator: Operator, seconds: float, *overrides: str) -> Operator:
    """World, bridge, arms and supervisor in stepped time: neither camera nor controller is needed."""
    names = ("world", "follower-can-bridge", "follower-arms", "follower-supervisor")
    clock, config = SteppedClock(), stepped_config(*overrides)
    nodes = [
        process(name).factory()(NodeContext(config, CONFIG_PATH, runtime, number, clock))
        for number, name in enumerate(names, start=1)
    ]
    with SteppedExecutor([*nodes, operator], clock) as executor:
        executor.run(clock.now_ns() + round(seconds * NS_PER_S))
    return operator


def test_jogging_goes_through_the_gate_and_ends_with_the_station(tmp_path: Path) -> None:
    operator = by_hand(tmp_path, Operator((9.0, 0.0), 4 * NS_PER_S), 6.0)
    fastest = max(drives.v_set_m_s for drives in operator.drives)
    assert fastest == pytest.approx(0.10)
    last = operator.drives[-1]
    assert last.wheel_angle_rad[0] * 0.085 > 0.15
    assert (last.v_set_m_s, operator.missions[-1].phase) == (0.0, "idle")
    assert operator.missions[-1].cause in ("manual: gate_stop: command_age", "manual: gate_stop: valid_until")
    assert last.state in ("stopped", "disarmed")
    assert last.lift_m == pytest.approx(operator.drives[0].lift_m, abs=1e-3)
    assert max(last.grip_angle_rad) < 0.3


def test_lift_and_fingers_move_and_nothing_else(tmp_path: Path) -> None:
    operator = by_hand(tmp_path, Operator((0.0, 0.0), 9 * NS_PER_S, grip="open", lift_m=0.15), 4.0)
    last = operator.drives[-1]
    assert last.lift_m == pytest.approx(0.15, abs=1e-3)
    assert min(last.grip_angle_rad) > 1.0
    assert last.v_set_m_s == 0.0
    assert last.joint_angle_rad == pytest.approx(operator.drives[0].joint_angle_rad, abs=0.15)


def test_in_shadow_everything_is_told_and_nothing_moves(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO")
    operator = by_hand(tmp_path, Operator((0.08, 0.0), 9 * NS_PER_S, lift_m=0.1), 4.0, "follower_can.shadow=true")
    armed = [drives for drives in operator.drives if drives.state == "armed"]
    assert armed[-1].v_set_m_s == pytest.approx(0.08)
    assert all(drives.shadow for drives in operator.drives)
    assert {drives.wheel_speed_rad_s for drives in operator.drives} == {(0.0, 0.0)}
    assert {drives.lift_m for drives in operator.drives} == {operator.drives[0].lift_m}
    assert operator.missions[-1].phase == "manual"
    assert "shadow: would command v +0.080 m/s" in caplog.text


def test_held_arrow_keys_move_and_let_go_they_stop() -> None:
    keys = Keys(0.05, 0.2)
    assert keys.step(0, "") == (0.0, 0.0)
    assert keys.step(0, "\x1b[A") == (0.05, 0.0)
    assert keys.step(500 * NS_PER_MS, "\x1b[A\x1b[A") == (0.05, 0.0)
    assert keys.step(640 * NS_PER_MS, "") == (0.05, 0.0)
    assert keys.step(650 * NS_PER_MS, "") == (0.0, 0.0)
    assert keys.step(700 * NS_PER_MS, "\x1b[D") == (0.0, 0.2)
    assert keys.step(710 * NS_PER_MS, " ") == (0.0, 0.0)
    assert keys.step(720 * NS_PER_MS, "\x1b[B") == (-0.05, 0.0)
    assert keys.step(1270 * NS_PER_MS, "") == (0.0, 0.0)


def test_fingers_are_done_when_open_or_when_they_stand() -> None:
    def felt(now_s: float, angle: float, gripped: bool = False, released: bool = False) -> ManualFeedback:
        state = replace(ARMS, gripped=gripped, released=released)
        return ManualFeedback(round(now_s * NS_PER_S), None, replace(DISARMED, grip_angle_rad=(angle, angle)), state)

    opening = Fingers("open")
    assert opening.step(felt(0.0, 0.2)) == (0.0, 0.0)
    assert opening.step(felt(0.5, 1.1, released=True)) is None
    closing = Fingers("closed")
    assert closing.step(felt(0.0, 1.0)) == (0.0, 0.0)
    assert closing.step(felt(0.9, 0.15, gripped=True)) == (0.0, 0.0)
    assert closing.step(felt(1.8, 0.15, gripped=True)) == (0.0, 0.0)
    assert closing.step(felt(1.9, 0.15, gripped=True)) is None
