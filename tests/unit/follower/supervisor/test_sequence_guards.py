"""Guards that end a docking in any phase, and what request and summary say then."""

from __future__ import annotations

from dataclasses import replace

import pytest

from common.geometry import Pose2
from common.messages import DockRequest
from common.timing import NS_PER_MS
from tests.rigs.supervisor_rig import ARMS, DRIVES, LEADER, Bench, docking_state

STEP_MS = 50


def ended(bench: Bench) -> tuple[str, str]:
    assert bench.mission is not None
    return bench.sequence.phase, bench.mission.cause


@pytest.mark.parametrize("phase", ["to_approach", "to_insert", "to_push", "to_lock"])
def test_a_process_that_restarts_ends_it(bench: Bench, phase: str) -> None:
    getattr(bench, phase)()
    bench.step(restarted="follower-estimator")
    assert ended(bench) == ("aborted", "restarted: follower-estimator")


@pytest.mark.parametrize("phase", ["to_approach", "to_insert", "to_push"])
def test_a_lock_that_closes_before_its_trolley_is_there_ends_it(bench: Bench, phase: str) -> None:
    getattr(bench, phase)()
    bench.step(leader=replace(LEADER, lock="locked"))
    assert ended(bench) == ("aborted", "lock_implausible")


def test_silence_of_the_drives_ends_it_after_a_quarter_of_a_second(bench: Bench) -> None:
    bench.to_approach()
    bench.step(drives=None)
    for _ in range(4):
        assert bench.step().mission.phase == "approach"
    bench.step()
    assert ended(bench) == ("aborted", "drives_silent")


def test_gaps_of_the_drives_do_not_add_up(bench: Bench) -> None:
    bench.to_approach()
    drives = bench.seen.drives
    for _ in range(4):
        bench.run(0.2, drives=None)
        bench.run(0.1, drives=drives)
    assert bench.sequence.phase == "approach"


def test_a_stall_of_the_supervisor_counts_as_a_tenth_of_a_second_of_silence(bench: Bench) -> None:
    bench.to_approach()
    for stalled_ms, phase in ((2000, "approach"), (2000, "approach"), (60, "aborted")):
        bench.seen = replace(bench.seen, now_ns=bench.seen.now_ns + (stalled_ms - STEP_MS) * NS_PER_MS)
        bench.step(drives=None)
        assert bench.sequence.phase == phase


def test_it_may_begin_before_the_drives_are_seen(bench: Bench) -> None:
    for _ in range(10):
        mission = bench.step(drives=None).mission
    assert (mission.phase, mission.cause, mission.trolley, mission.resets) == ("idle", "", 1, 0)
    assert (mission.motion, mission.contact_expected, mission.waiting) == ("hold", False, "")
    speeds = (mission.straight_speed_m_s, mission.turn_rate_rad_s, mission.v_max_m_s, mission.w_max_rad_s)
    assert speeds == (0.0,) * 4


@pytest.mark.parametrize(
    "cause", ["command_age", "valid_until", "token_age", "status_age", "arm_setpoint_age", "bridge_stalled"]
)
def test_a_missed_deadline_is_rearmed(bench: Bench, cause: str) -> None:
    bench.to_approach()
    assert bench.seen.drives is not None
    bench.step(drives=replace(bench.seen.drives, state="stopped", cause=cause))
    assert bench.sequence.phase == "acquire"


@pytest.mark.parametrize("cause", ["node_silent: left wheel", "bus_lost: bus-off", "status_age", "bridge_stalled"])
def test_stop_inputs_that_are_silent_with_the_drives_are_no_pressed_button(bench: Bench, cause: str) -> None:
    bench.to_approach()
    drives = bench.seen.drives
    assert drives is not None
    bench.step(drives=replace(drives, state="stopped", cause=cause, stop_inputs_clear=False))
    assert bench.sequence.phase == "acquire"
    other = replace(drives, state="armed", cause=cause, stop_inputs_clear=False)
    bench.step(drives=other)
    assert ended(bench) == ("aborted", "stop_input"), "the drives answer"


def test_each_request_is_answered_by_what_it_did(bench: Bench) -> None:
    bench.run(0.2)
    answer = bench.ask("abort")
    assert (answer.outcome, answer.reason) == ("done", "nothing to abort in phase idle")
    assert bench.ask("start").reason == "docking trolley 1"
    assert bench.ask("reset").reason == "phase acquire is under way"
    assert bench.ask("abort").reason == "aborted"
    assert ended(bench) == ("aborted", "operator_abort")
    assert bench.ask("start").outcome == "accepted"
    assert ended(bench)[1] == "", "the cause of the docking before is over"
    bench.ask("abort")
    assert bench.ask("reset").reason == "idle"
    assert ended(bench) == ("idle", "")
    late = DockRequest("late", bench.seen.now_ns, "start")
    (answer,) = bench.step(requests=(late,)).answers
    assert (answer.outcome, answer.reason) == ("expired", "expired before it was handled")


def test_resets_are_counted_for_the_drives(bench: Bench) -> None:
    for count in (1, 2):
        bench.ask("reset")
        assert bench.mission is not None
        assert bench.mission.resets == count


def test_a_long_cause_is_cut_to_what_a_message_takes(bench: Bench) -> None:
    bench.to_approach()
    assert bench.seen.drives is not None
    outputs = bench.step(drives=replace(bench.seen.drives, state="fault", cause="x" * 400))
    assert outputs.mission.cause == outputs.summary.cause == "drive_fault: " + "x" * 387


def test_a_long_wait_is_cut_to_what_a_message_takes(bench: Bench) -> None:
    bench.run(0.2)
    bench.ask("start")
    outputs = bench.step(leader=replace(LEADER, lock="fault", cause="x" * 400))
    assert outputs.mission.waiting == outputs.summary.waiting == "the Leader's lock has a fault: " + "x" * 369


def test_the_summary_says_moving_unless_it_stands_and_is_to_stand(bench: Bench) -> None:
    bench.run(0.3)
    assert not bench.step().summary.moving
    for n in range(10):
        rolling = bench.step(drives=bench.roll(0.05 * (n + 1)))
    assert rolling.summary.moving
    bench.run(0.3)
    assert bench.step(drives=None).summary.moving, "unknown"
    bench.seen = replace(bench.seen, drives=DRIVES)
    bench.to_approach()
    assert bench.step().summary.moving, "it is about to"
    bench.run(0.3, state=docking_state(bench.config, Pose2(5, 0, 0), valid=False))
    paused = bench.step()
    assert (paused.mission.armed, paused.mission.motion, paused.summary.moving) == (True, "hold", False)


def test_a_released_trolley_that_is_gripped_again_may_touch_the_queue(bench: Bench) -> None:
    x_m = bench.config.docking.goal(2).x_m + 0.303
    clear = bench.step(state=docking_state(bench.config, Pose2(x_m, 0.0, 0.0)), leader=replace(LEADER, queue=1))
    assert not clear.summary.in_contact
    bench.step(leader=None)
    assert not bench.step().summary.in_contact, "still the same trolley"
    assert not bench.step(arms=replace(ARMS, gripped=False, released=True)).summary.in_contact
    assert bench.step(arms=ARMS).summary.in_contact, "another one, perhaps"
    assert bench.step(arms=None).summary.in_contact
