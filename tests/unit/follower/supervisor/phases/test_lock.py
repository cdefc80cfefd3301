"""Lock, release and retract: bounded in time, one request, and only the Leader's own confirmation counts."""

from __future__ import annotations

from dataclasses import replace

import pytest

from common.geometry import Pose2
from common.messages import Answer, ArmState
from common.timing import NS_PER_MS
from tests.rigs.supervisor_rig import ARMS, LEADER, Bench, docking_state

LOCKED = replace(LEADER, lock="locked")
OPEN = ArmState(0.0, False, False, False, True)


def cause(bench: Bench) -> str:
    assert bench.mission is not None
    return bench.mission.cause


def confirm(bench: Bench, outcome: str = "done") -> str:
    """The answer to the request; the phase afterwards."""
    answer = Answer(bench.lock_requests[-1].id, outcome, "locked")  # type: ignore[arg-type] # given by the test
    bench.step(lock_answers=(answer,))
    return bench.sequence.phase


def to_release(bench: Bench) -> None:
    bench.to_lock()
    bench.step(leader=LOCKED)
    assert confirm(bench) == "release"


def to_retract(bench: Bench) -> None:
    to_release(bench)
    bench.step(arms=OPEN)
    assert bench.sequence.phase == "retract"


def test_the_first_trolley_is_locked_under_one_id_asked_for_once_a_second(bench: Bench) -> None:
    bench.to_lock()
    bench.lock_requests.clear()
    assert bench.mission is not None
    epoch = bench.mission.epoch
    bench.run(3.0)
    assert bench.mission.waiting == "the Leader's lock"
    assert bench.mission.contact_expected
    assert [(each.action, each.id, each.trolley) for each in bench.lock_requests] == [
        ("lock", f"lock-{epoch}", 1)
    ] * 3
    assert {each.valid_for_ms for each in bench.lock_requests} == {8000}


def test_behind_a_later_trolley_the_lock_is_asked_whether_it_holds(bench: Bench) -> None:
    goal = bench.config.docking.goal(2)
    leader = replace(LOCKED, queue=1)
    bench.run(0.2, leader=leader)
    assert bench.ask("start", trolley=2).outcome == "accepted"
    assert bench.run(0.7) == "approach"
    assert bench.run(bench.config.docking.settle_s + 0.2, **bench.there(goal)) == "insert"
    bench.step()
    bench.step(drives=bench.roll(0.06), arms=replace(ARMS, contact=True))
    docked = docking_state(bench.config, Pose2(goal.x_m - 0.14, 0.0, 0.0))
    bench.step(drives=bench.roll(0.14), arms=replace(ARMS, contact=True, connected=True), state=docked)
    assert bench.sequence.phase == "lock"
    assert (bench.lock_requests[0].action, bench.lock_requests[0].trolley) == ("confirm", 2)
    assert confirm(bench) == "release"


def test_an_answer_to_another_request_confirms_nothing(bench: Bench) -> None:
    bench.to_lock()
    bench.step(leader=LOCKED)
    for outcome in ("done", "refused"):
        bench.step(lock_answers=(Answer("lock-1", outcome, ""),))
        assert bench.sequence.phase == "lock"


def test_without_a_confirmation_it_ends_in_time_and_only_time_with_a_link_counts(bench: Bench) -> None:
    bench.to_lock()
    bench.run(5.0, leader=None)
    assert bench.run(7.9, leader=LEADER) == "lock"
    assert bench.run(0.3) == "aborted"
    assert cause(bench) == "lock_timeout"


def test_grippers_that_do_not_open_end_it(bench: Bench) -> None:
    to_release(bench)
    assert bench.run(bench.config.supervisor.grip_timeout_s - 0.1) == "release"
    assert bench.mission is not None
    assert bench.mission.waiting == "grippers to open"
    assert bench.run(0.2) == "aborted"
    assert cause(bench) == "release_timeout"


@pytest.mark.parametrize(
    ("volts", "named"), [(25.0, "retract_timeout"), (21.9, "retract_timeout: battery at 21.9 V")]
)
def test_the_way_back_is_bounded_in_time_too(bench: Bench, volts: float, named: str) -> None:
    """Nothing looks backwards: 1.3 times the time that it takes, and a second."""
    to_retract(bench)
    assert bench.seen.drives is not None
    bench.seen = replace(bench.seen, drives=replace(bench.seen.drives, battery_v=volts))
    assert bench.run(6.2) == "retract"
    bench.seen = replace(bench.seen, now_ns=bench.seen.now_ns - 40 * NS_PER_MS)
    bench.step()
    assert bench.sequence.phase == "aborted"
    assert cause(bench).startswith(named)
    assert (":" in cause(bench)) == (volts < 22.0)


def test_on_the_way_back_it_waits_for_drives_that_are_silent_for_a_moment(bench: Bench) -> None:
    to_retract(bench)
    drives = bench.seen.drives
    mission = bench.step(drives=None).mission
    assert (mission.motion, mission.waiting) == ("hold", "drives")
    mission = bench.step(drives=drives).mission
    assert (mission.motion, mission.contact_expected, mission.waiting) == ("straight", False, "")
    assert (mission.straight_speed_m_s, mission.v_max_m_s, mission.w_max_rad_s) == (-0.1, 0.1, 0.0)
