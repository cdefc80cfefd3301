"""Moving the robot by hand: when it is armed, and when it ends."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from common.config import Config
from common.messages import (
    Answer,
    ArmState,
    Command,
    DockRequest,
    ManualRequest,
    Mission,
    seal_command,
)
from common.timing import NS_PER_S
from follower.supervisor.manual import ManualInputs, ManualMode
from tests.rigs.supervisor_rig import ARMS, Bench
from tests.rigs.supervisor_rig import DRIVES as DISARMED

STEP_NS = NS_PER_S // 20


class Hand:
    """A manual mode beside an idle docking, and a station whose commands stay fresh."""

    def __init__(self, config: Config) -> None:
        docking = Bench(config)
        self.idle = docking.step().mission
        self.mode = ManualMode(config, run_id=77)
        self.seen = ManualInputs(now_ns=NS_PER_S, phase="idle", drives=DISARMED, arms=ARMS, command=None)

    def step(self, **changes: Any) -> tuple[Answer, ...]:
        self.seen = replace(self.seen, now_ns=self.seen.now_ns + STEP_NS, **changes)
        answers = self.mode.answer(self.seen)
        self.mode.watch(self.seen)
        self.seen = replace(self.seen, requests=())
        return answers

    def ask(self, action: Any = "start", **fields: Any) -> Answer:
        request = ManualRequest(f"m-{self.seen.now_ns}", self.seen.now_ns + NS_PER_S, action, **fields)
        (answer,) = self.step(requests=(request,))
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
        ({"phase": "aborted"}, "the last docking was aborted: reset first (davpc dock reset)"),
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
    assert (answer.outcome, answer.reason) == ("refused", "the lift reaches at most 500 mm (follower_can.lift_max_m)")
    assert hand.ask(lift_m=0.5).outcome == "accepted"


def test_the_travel_is_named_in_millimetres(config: Config) -> None:
    can = config.follower_can.model_copy(update={"lift_max_m": 0.7})
    answer = Hand(config.model_copy(update={"follower_can": can})).ask(lift_m=0.8)
    assert answer.reason == "the lift reaches at most 700 mm (follower_can.lift_max_m)"


def test_an_expired_request_and_a_second_station_arm_nothing(hand: Hand) -> None:
    old = ManualRequest("old", hand.seen.now_ns - 1, "start")
    assert hand.step(requests=(old,))[0].outcome == "expired"
    assert not hand.mode.active
    epoch = hand.under_way()
    second = hand.ask()
    assert (second.outcome, second.reason) == ("refused", "manual mode is in use by another station")
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
    assert hand.mode.answer_docking(start).outcome == "refused"
    assert hand.mode.active
    assert hand.mode.answer_docking(replace(start, action="abort")).outcome == "done"
    assert not hand.mode.active


def test_each_answer_says_what_it_did(hand: Hand) -> None:
    assert hand.ask().reason == "armed as long as its commands arrive"
    abort = DockRequest("a", hand.seen.now_ns + NS_PER_S, "abort")
    assert hand.mode.answer_docking(replace(abort, action="start")).reason == "manual mode is on"
    assert hand.mode.answer_docking(abort).reason == "manual mode ended"
    assert hand.mission.cause == "manual: operator_abort"
    assert hand.ask("stop").reason == "disarmed"
    assert hand.mission.cause == ""
    old = ManualRequest("old", hand.seen.now_ns - 1, "start")
    assert hand.step(requests=(old,))[0].reason == "expired before it was handled"


def test_the_cause_of_the_last_time_is_over_when_it_begins_and_shown_once_done_too(hand: Hand) -> None:
    hand.under_way()
    for _ in range(8):
        hand.step(command=None)
    done = replace(hand.idle, phase="done")
    assert hand.mode.mission(done).cause == "manual: station_silent"
    assert hand.mode.mission(replace(done, cause="other")).cause == "other"
    hand.ask()
    assert (hand.mission.cause, hand.mission.straight_speed_m_s) == ("", 0.0)
    hand.ask("stop")
    assert hand.mission.cause == ""


def test_the_first_command_has_two_seconds_more(hand: Hand) -> None:
    assert hand.ask().outcome == "accepted"
    for _ in range(40 + 3):
        hand.step()
        assert hand.mode.active
    hand.step()
    assert hand.mission.cause == "manual: station_silent"


@pytest.mark.parametrize(("silent_ms", "active"), [(150, True), (151, False)])
def test_a_station_may_be_silent_for_150_ms(hand: Hand, silent_ms: int, active: bool) -> None:
    hand.under_way()
    hand.seen = replace(hand.seen, now_ns=hand.seen.now_ns - STEP_NS + silent_ms * NS_PER_S // 1000)
    hand.step(command=None)
    assert hand.mode.active == active


@pytest.mark.parametrize(("silent_ms", "active"), [(300, True), (301, False)])
def test_drives_may_be_silent_for_300_ms(hand: Hand, silent_ms: int, active: bool) -> None:
    hand.under_way()
    hand.seen = replace(hand.seen, now_ns=hand.seen.now_ns - STEP_NS + silent_ms * NS_PER_S // 1000)
    hand.step(drives=None)
    assert hand.mode.active == active


def test_drives_that_answer_now_and_then_are_not_silent(hand: Hand) -> None:
    hand.under_way()
    drives = hand.seen.drives
    for n in range(20):
        hand.step(drives=drives if n % 4 == 3 else None)
        assert hand.mode.active


def test_a_long_cause_is_cut_to_what_a_message_takes(hand: Hand) -> None:
    hand.seen = replace(hand.seen, drives=replace(DISARMED, state="fault", cause="x" * 400))
    assert hand.ask().reason == "drives: " + "x" * 392
    hand.seen = replace(hand.seen, drives=DISARMED)
    hand.under_way()
    assert hand.seen.drives is not None
    hand.step(drives=replace(hand.seen.drives, state="fault", cause="x" * 400))
    assert hand.mission.cause == "manual: gate_stop: " + "x" * 381
