"""In contact with the queue: what counts as contact, what ends it, and the lock step."""

from __future__ import annotations

from dataclasses import replace

import pytest

from common.config import Config
from common.geometry import Pose2
from common.messages import Answer
from tests.rigs.supervisor_rig import ARMS, LEADER, Bench, docking_state


def test_what_ends_in_contact_waits_for_an_operator(bench: Bench) -> None:
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


@pytest.mark.parametrize("cause", ["slip", "collision"])
def test_the_supervisor_stops_by_what_the_arms_name(config: Config, cause: str) -> None:
    bench = Bench(config)
    bench.to_approach()
    arms = bench.seen.arms
    assert arms is not None
    bench.step(arms=replace(arms, cause=cause))  # type: ignore[arg-type]
    assert bench.mission is not None
    assert (bench.mission.phase, bench.mission.cause, bench.mission.armed) == ("aborted", cause, False)
    assert bench.mission.grip == "closed"
    assert bench.ask("start").outcome == "refused"


def test_a_rigid_resistance_on_the_approach_ends_it(config: Config) -> None:
    bench = Bench(config)
    bench.to_approach()
    arms = bench.seen.arms
    assert arms is not None
    bench.step(arms=replace(arms, contact=True, connected=True))
    assert bench.mission is not None
    assert (bench.mission.phase, bench.mission.cause) == ("aborted", "contact_early")
