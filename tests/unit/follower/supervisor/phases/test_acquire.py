"""Acquire and search: what is waited for, what ends them by name, and how the robot turns."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from common.config import Config
from common.geometry import Pose2
from tests.rigs.supervisor_rig import ARMS, Bench, docking_state


def lost(config: Config, cause: Any = "few_leds") -> Any:
    return replace(docking_state(config, Pose2(5.0, 0.0, 0.0), valid=False), cause=cause)


def ended(bench: Bench) -> tuple[str, str]:
    assert bench.mission is not None
    return bench.sequence.phase, bench.mission.cause


def to_search(bench: Bench) -> None:
    bench.to_approach()
    while bench.sequence.phase == "approach":
        bench.step(state=lost(bench.config))
    assert bench.sequence.phase == "search"


def turned(bench: Bench, heading_rad: float) -> Any:
    """The drives at this heading."""
    base = bench.config.base
    angle = heading_rad * base.track_m / 2 / base.wheel_radius_m
    assert bench.seen.drives is not None
    return replace(bench.seen.drives, wheel_angle_rad=(-angle, angle))


@pytest.mark.parametrize("cause", ["no_frame", "stale_frame", "bad_frame", "frozen_camera", "not_following"])
def test_without_an_image_turning_would_not_help(bench: Bench, cause: str) -> None:
    bench.run(0.2, state=lost(bench.config, cause))
    bench.ask("start")
    assert bench.run(6.0) == "aborted"
    assert ended(bench)[1] == f"camera_silent: {cause}"


def test_an_empty_gripper_arms_nothing(bench: Bench) -> None:
    bench.run(0.2)
    bench.ask("start")
    bench.run(0.2)
    for arms in (replace(ARMS, gripped=False), None):
        mission = bench.step(arms=arms).mission
        assert not mission.armed
        assert mission.waiting == ("arms silent" if arms is None else "no trolley in the grippers")


def test_drives_that_do_not_follow_are_named_with_what_they_report(bench: Bench) -> None:
    bench.run(0.2)
    bench.ask("start")
    assert bench.seen.drives is not None
    mute = replace(bench.seen.drives, state="enabling", cause="")
    bench.run(1.0, drives=mute)
    assert bench.mission is not None
    assert (bench.mission.armed, bench.mission.waiting) == (True, "drives")
    bench.run(5.0, drives=replace(mute, cause="arm_setpoint_age"))
    assert ended(bench) == ("aborted", "acquire_timeout: drives not enabled (arm_setpoint_age)")


def test_what_was_missing_last_is_named_even_if_it_came_back_too_late(bench: Bench) -> None:
    bench.run(0.2, controller_alive=False)
    bench.ask("start")
    bench.run(4.7)
    bench.run(1.0, controller_alive=True)
    assert ended(bench) == ("aborted", "acquire_timeout: controller silent")


def test_it_turns_left_then_right_then_back_and_slower_near_the_end(bench: Bench) -> None:
    to_search(bench)
    bench.run(1.0)
    assert bench.mission is not None
    assert bench.sequence.attempt.searches == 1
    most = math.radians(30.0)
    assert (bench.mission.motion, bench.mission.turn_rate_rad_s, bench.mission.waiting) == ("turn", 0.2, "LEDs")
    assert bench.mission.w_max_rad_s == 0.2
    for at_rad, rate in ((most - 0.15, 0.15), (most - 0.03, 0.05)):
        assert bench.step(drives=turned(bench, at_rad)).mission.turn_rate_rad_s == pytest.approx(rate)
    there = bench.step(drives=turned(bench, most - 0.0199)).mission
    assert (there.motion, there.waiting) == ("hold", "LEDs")
    assert bench.step().mission.turn_rate_rad_s == -0.2
    assert bench.step(drives=turned(bench, -most + 0.0202)).mission.turn_rate_rad_s == -0.05
    assert bench.step(drives=turned(bench, -most + 0.0198)).mission.motion == "hold"
    assert bench.step().mission.turn_rate_rad_s == 0.2


def test_it_stands_as_soon_as_the_array_is_in_view(bench: Bench) -> None:
    valid = bench.seen.state
    to_search(bench)
    bench.run(1.0)
    mission = bench.step(state=valid).mission
    assert (mission.motion, mission.waiting) == ("hold", "LEDs")


def test_headings_are_counted_from_where_the_search_began(bench: Bench) -> None:
    bench.seen = replace(bench.seen, drives=turned(bench, 2.0))
    bench.run(0.3)
    to_search(bench)
    bench.run(1.0)
    assert bench.step(drives=turned(bench, 2.0 + math.radians(30.0))).mission.motion == "hold"


def test_a_turn_that_is_not_completed_ends_it(bench: Bench) -> None:
    """Twice the time of the longest turn, and five seconds."""
    to_search(bench)
    limit_s = 2.0 * (2.0 * math.radians(30.0) / 0.2) + 5.0
    assert bench.run(limit_s - 0.1) == "search"
    bench.run(0.15)
    assert ended(bench) == ("aborted", "search_timeout: the turn was not completed")


def test_drives_that_do_not_follow_end_a_search(bench: Bench) -> None:
    bench.run(0.2, state=lost(bench.config))
    bench.ask("start")
    bench.run(3.2)
    assert bench.sequence.phase == "search"
    assert bench.seen.drives is not None
    bench.run(16.0, drives=replace(bench.seen.drives, state="enabling"))
    assert ended(bench) == ("aborted", "search_timeout: drives not enabled")


@pytest.mark.parametrize(
    ("changes", "waiting", "cause"),
    [
        ({"state": None}, "no docking state", "estimator_silent"),
        ({"controller_alive": False}, "controller silent", "unwell: controller silent"),
    ],
)
def test_what_is_unwell_stands_and_ends_a_search_after_three_seconds(
    bench: Bench, changes: dict[str, Any], waiting: str, cause: str
) -> None:
    to_search(bench)
    bench.run(1.0)
    mission = bench.step(**changes).mission
    assert (mission.motion, mission.waiting) == ("hold", waiting)
    for _ in range(60):
        assert bench.step().mission.phase == "search"
    bench.step()
    assert ended(bench) == ("aborted", cause)
