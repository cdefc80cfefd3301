"""Insert and push: what pauses and ends them, and which end of a push counts as docked."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from common.config import Config
from common.geometry import Pose2
from follower.supervisor.image_trust import NOT_FOLLOWING
from tests.rigs.supervisor_rig import ARMS, LEADER, Bench, docking_state

CONNECTED = replace(ARMS, contact=True, connected=True)
LOCKED = replace(LEADER, lock="locked", queue=1)


def cause(bench: Bench) -> str:
    assert bench.mission is not None
    return bench.mission.cause


def blind(config: Config, seen_as: Any = "few_leds") -> Any:
    return replace(docking_state(config, Pose2(5.0, 0.0, 0.0), valid=False), cause=seen_as)


def to_push_of_the_second(bench: Bench) -> None:
    bench.run(0.2, leader=LOCKED)
    assert bench.ask("start", trolley=2).outcome == "accepted"
    assert bench.run(0.7) == "approach"
    there = bench.there(bench.config.docking.goal(2))
    assert bench.run(bench.config.docking.settle_s + 0.2, **there) == "insert"
    bench.step()
    bench.step(drives=bench.roll(0.06), arms=replace(ARMS, contact=True))
    assert bench.sequence.phase == "push"


def connected_at(bench: Bench, pushed_m: float, x_m: float, y_m: float = 0.0) -> str:
    """The push ends there by wheels and LEDs; the phase afterwards. ``x_m`` from the goal on."""
    goal = bench.config.docking.goal(bench.sequence.attempt.trolley)
    state = docking_state(bench.config, Pose2(goal.x_m - x_m, y_m, 0.0))
    bench.step(drives=bench.roll(pushed_m), arms=CONNECTED, state=state)
    return bench.sequence.phase


@pytest.mark.parametrize("phase", ["to_insert", "to_push"])
@pytest.mark.parametrize(
    ("lost", "waiting", "ended"),
    [
        ({"state": None}, "no docking state", "estimator_silent"),
        ({"blind": True}, "LEDs not acquired (few_leds)", "leds_lost: in contact"),
        ({"blind": True, "leader": None}, "LEDs not acquired (few_leds)", "leader_lost: in contact"),
        ({"controller_alive": False}, "controller silent", "unwell: controller silent"),
        ({"arms": None}, "arms silent", "unwell: arms silent"),
        (
            {"late": "follower-arms"},
            "follower-arms runs late: the computer cannot keep up",
            "unwell: follower-arms runs",
        ),
    ],
)
def test_what_is_lost_stands_in_contact_and_ends_it_after_three_seconds(
    bench: Bench, phase: str, lost: dict[str, Any], waiting: str, ended: str
) -> None:
    getattr(bench, phase)()
    bench.step()
    changes = {key: value for key, value in lost.items() if key != "blind"}
    if "blind" in lost:
        changes["state"] = blind(bench.config)
    mission = bench.step(**changes).mission
    assert (mission.motion, mission.armed, mission.contact_expected) == ("hold", True, True)
    assert mission.waiting == waiting
    for _ in range(60):
        assert bench.step().mission.phase == phase.removeprefix("to_")
    bench.step()
    assert bench.sequence.phase == "aborted"
    assert cause(bench).startswith(ended)


@pytest.mark.parametrize("phase", ["to_insert", "to_push"])
def test_drives_that_are_silent_for_a_moment_are_waited_for(bench: Bench, phase: str) -> None:
    getattr(bench, phase)()
    bench.step()
    drives = bench.seen.drives
    mission = bench.step(drives=None).mission
    assert (mission.motion, mission.contact_expected, mission.waiting) == ("hold", True, "drives")
    mission = bench.step(drives=drives).mission
    assert (mission.motion, mission.contact_expected, mission.straight_speed_m_s) == ("straight", True, 0.05)


@pytest.mark.parametrize("phase", ["to_insert", "to_push"])
def test_a_doubt_about_the_image_ends_it_although_the_image_moves_again(bench: Bench, phase: str) -> None:
    """In contact nothing can be turned to see whether the image lives."""
    getattr(bench, phase)()
    valid = bench.seen.state
    bench.step(state=blind(bench.config, "not_following"))
    assert bench.sequence.phase == phase.removeprefix("to_")
    bench.run(5.0, state=valid)
    assert (bench.sequence.phase, cause(bench)) == ("aborted", f"not_following: {NOT_FOLLOWING}")


def test_a_push_without_motion_is_bounded_by_its_time(bench: Bench) -> None:
    """Twice the time that the longest push takes, and three seconds: 13 s."""
    bench.to_push()
    assert bench.run(12.9) == "push"
    assert bench.run(0.15) == "aborted"
    assert cause(bench) == "push_timeout"


def test_a_rigid_connection_without_leds_is_waited_for(bench: Bench) -> None:
    bench.to_push()
    mission = bench.step(drives=bench.roll(0.14), arms=CONNECTED, state=blind(bench.config)).mission
    assert (mission.phase, mission.motion, mission.contact_expected, mission.waiting) == (
        "push",
        "hold",
        True,
        "LEDs",
    )
    for _ in range(60):
        assert bench.step().mission.phase == "push"
    bench.step()
    assert (bench.sequence.phase, cause(bench)) == ("aborted", "leds_lost: in contact")


def test_a_rigid_connection_without_an_estimate_is_waited_for_too(bench: Bench) -> None:
    bench.to_push()
    assert bench.step(drives=bench.roll(0.14), arms=CONNECTED, state=None).mission.waiting == "LEDs"
    bench.run(3.1)
    assert (bench.sequence.phase, cause(bench)) == ("aborted", "estimator_silent")


@pytest.mark.parametrize(("pushed_m", "phase"), [(0.119, "aborted"), (0.121, "lock")])
def test_less_than_four_fifths_of_the_stroke_is_early_contact(bench: Bench, pushed_m: float, phase: str) -> None:
    bench.to_push()
    assert connected_at(bench, pushed_m, 0.145) == phase
    assert cause(bench) == ("" if phase == "lock" else "contact_early")


@pytest.mark.parametrize(("x_m", "phase"), [(0.1352, "lock"), (0.1348, "aborted")])
def test_by_the_leds_it_may_be_15_mm_short(bench: Bench, x_m: float, phase: str) -> None:
    bench.to_push()
    assert connected_at(bench, 0.15, x_m) == phase


@pytest.mark.parametrize(("x_m", "phase"), [(0.209, "lock"), (0.211, "aborted")])
def test_leds_and_wheels_agree_along(bench: Bench, x_m: float, phase: str) -> None:
    bench.to_push()
    assert connected_at(bench, 0.15, x_m) == phase
    assert cause(bench) == ("" if phase == "lock" else "contact_elsewhere")


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("y_m", "phase"), [(0.119, "lock"), (0.121, "aborted")])
def test_across_the_first_may_be_6_cm_beyond_its_bound(bench: Bench, y_m: float, side: float, phase: str) -> None:
    bench.to_push()
    assert connected_at(bench, 0.15, 0.15, side * y_m) == phase


@pytest.mark.parametrize(("y_m", "phase"), [(0.159, "lock"), (0.161, "aborted")])
def test_across_a_later_one_has_a_wider_bound(bench: Bench, y_m: float, phase: str) -> None:
    to_push_of_the_second(bench)
    assert connected_at(bench, 0.15, 0.15, y_m) == phase
