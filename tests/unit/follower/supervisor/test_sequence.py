"""The phases of a docking, driven through by what is observed."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest

from common.config import Config
from common.geometry import Pose2
from common.messages import Answer, ArmState, DockRequest
from tests.rigs.supervisor_rig import LEADER, Bench, docking_state


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


def test_a_weak_battery_stands_on_the_way_back_from_the_queue(bench: Bench) -> None:
    bench.to_lock()
    bench.run(0.1, leader=replace(LEADER, lock="locked"))
    bench.step(lock_answers=(Answer(bench.lock_requests[0].id, "done", "locked"),))
    assert bench.run(0.1, arms=ArmState(0.0, False, False, False, True)) == "retract"
    assert bench.mission is not None
    assert bench.seen.drives is not None
    strong = bench.seen.drives
    assert bench.run(0.1, drives=replace(strong, battery_v=21.9)) == "retract"
    assert (bench.mission.motion, bench.mission.waiting[:7]) == ("hold", "battery")
    bench.run(0.1, drives=strong)
    assert bench.mission.straight_speed_m_s < 0


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
        (True, "few_leds", "leds_lost: too close for a search"),
        (False, "few_leds", "leader_lost: too close for a search"),
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


def test_requests_that_make_no_sense_are_refused_and_old_ones_expire(bench: Bench) -> None:
    bench.to_approach()
    assert bench.ask("start").outcome == "refused"
    assert bench.ask("reset").outcome == "refused"
    old = DockRequest("old", 1, "abort")
    (answer,) = bench.step(requests=(old,)).answers
    assert (answer.outcome, bench.sequence.phase) == ("expired", "approach")
    assert bench.ask("abort").outcome == "done"
    assert bench.sequence.phase == "aborted"
