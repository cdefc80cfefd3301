"""Approach: what counts as nearer and as arrived, what is tried again, and how fast it may be."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from common.config import Config
from common.geometry import Pose2
from common.timing import NS_PER_MS, NS_PER_S
from tests.rigs.supervisor_rig import ARMS, LEADER, Bench, docking_state

STALL_S = 15.0


def at(bench: Bench, x_m: float, y_m: float = 0.0, theta_rad: float = 0.0) -> Any:
    """The state so far beyond the goal."""
    return docking_state(bench.config, Pose2(bench.config.docking.goal(1).x_m + x_m, y_m, theta_rad))


def move(bench: Bench, x_m: float, y_m: float = 0.0, theta_rad: float = 0.0) -> str:
    """Be there, by LEDs and odometry."""
    goal_m = bench.config.docking.goal(1).x_m
    bench.step(**bench.there(Pose2(goal_m + x_m, y_m, theta_rad)))
    return bench.sequence.phase


def cause(bench: Bench) -> str:
    assert bench.mission is not None
    return bench.mission.cause


@pytest.mark.parametrize(("before_m", "speed"), [(1.0, 0.10), (1.2, math.sqrt(0.01 + 0.3 * 0.2)), (2.5, 0.5)])
def test_the_speed_falls_towards_the_last_metre(bench: Bench, before_m: float, speed: float) -> None:
    bench.to_approach()
    move(bench, before_m)
    assert bench.mission is not None
    assert bench.mission.v_max_m_s == pytest.approx(speed, abs=1e-6)


@pytest.mark.parametrize(
    ("step", "phase"),
    [
        ((0.97, 0.0, 0.0), "approach"),
        ((0.9798, 0.0, 0.0), "approach"),
        ((0.9802, 0.0, 0.0), "staging"),
        ((1.0, 0.0, 0.0), "staging"),
    ],
)
def test_two_centimetres_nearer_is_progress(bench: Bench, step: tuple[float, float, float], phase: str) -> None:
    bench.to_approach()
    move(bench, 1.0)
    bench.run(10.0)
    move(bench, *step)
    bench.run(10.0)
    assert bench.sequence.phase == phase


@pytest.mark.parametrize(("theta_rad", "phase"), [(0.1596, "approach"), (0.1604, "staging")])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_heading_counts_by_half_a_metre(bench: Bench, theta_rad: float, side: float, phase: str) -> None:
    bench.to_approach()
    move(bench, 1.0, 0.0, side * 0.2)
    bench.run(10.0)
    move(bench, 1.0, 0.0, side * theta_rad)
    bench.run(10.0)
    assert bench.sequence.phase == phase


def test_three_centimetres_nearer_sideways_are_progress(bench: Bench) -> None:
    bench.to_approach()
    for y_m in (0.3, 0.27):
        move(bench, 0.0, y_m)
        bench.run(10.0)
    assert bench.sequence.phase == "approach"


def test_it_comes_no_nearer_for_fifteen_seconds(bench: Bench) -> None:
    bench.to_approach()
    move(bench, 1.0)
    assert bench.run(STALL_S - 0.1) == "approach"
    assert bench.run(0.2) == "staging"


def test_a_pause_is_no_lack_of_progress(bench: Bench) -> None:
    bench.to_approach()
    move(bench, 1.0)
    for _ in range(4):
        bench.step(controller_alive=False)
        bench.run(2.5)
        bench.step(controller_alive=True)
        bench.run(2.0)
    assert bench.sequence.phase == "approach"


def test_at_the_goal_it_is_not_stalled_while_it_settles(config: Config) -> None:
    slow = config.model_copy(update={"docking": config.docking.model_copy(update={"settle_s": 20.0})})
    bench = Bench(slow)
    bench.to_approach()
    move(bench, 0.0)
    assert bench.run(19.5) == "approach"
    assert bench.run(0.7) == "insert"


@pytest.mark.parametrize(("beyond_m", "phase"), [(0.149, "approach"), (0.151, "staging")])
def test_beyond_the_goal_it_tries_again(bench: Bench, beyond_m: float, phase: str) -> None:
    bench.to_approach()
    bench.run(2.5)
    assert move(bench, -beyond_m) == phase


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"arms": replace(ARMS, contact=True)}, "overshot: no retry with something in contact"),
        ({"arms": replace(ARMS, gripped=False)}, "overshot: no retry with something in contact"),
        ({"leader": replace(LEADER, lock="fault", cause="jam")}, "overshot: no retry with something in contact"),
    ],
)
def test_nothing_is_tried_again_in_contact_or_with_a_lock_engaged(
    bench: Bench, changes: dict[str, Any], named: str
) -> None:
    bench.to_approach()
    bench.run(2.5, **changes)
    assert move(bench, -0.2) == "aborted"
    assert cause(bench).startswith(named)


def test_a_retry_waits_until_it_has_been_well_for_two_seconds(bench: Bench) -> None:
    bench.to_approach()
    bench.step(controller_alive=False)
    bench.step(controller_alive=True)
    well_ns = bench.seen.now_ns
    bench.run(0.6)
    move(bench, -0.2)
    while bench.sequence.phase == "approach":
        bench.step()
    assert (bench.seen.now_ns - well_ns, bench.sequence.phase) == (2 * NS_PER_S, "staging")


@pytest.mark.parametrize(("led_missing", "seconds"), [(False, 60.0), (True, 298.8)])
def test_an_approach_takes_a_minute_at_most_or_longer_where_it_is_slowed_down(
    bench: Bench, led_missing: bool, seconds: float
) -> None:
    """With a LED missing, which takes 0.3 s to notice, it drives at a fifth of the speed."""
    bench.to_approach()
    began_ns, x_m, step = bench.seen.now_ns, 3.4, 0
    while bench.sequence.phase == "approach" and step < 8000:
        step += 1
        if step % 200 == 0:
            x_m -= 0.03
            bench.seen = replace(bench.seen, **bench.there(Pose2(bench.config.docking.goal(1).x_m + x_m, 0, 0)))
        assert bench.seen.state is not None
        features = (*((0.0, 0.0),) * 3, None if led_missing else (0.0, 0.0))
        bench.step(state=replace(bench.seen.state, features=features))
    assert (bench.seen.now_ns - began_ns) * 1e-9 == pytest.approx(seconds, abs=0.4)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("degrees", "phase"), [(0.95, "insert"), (1.05, "approach")])
def test_it_has_arrived_within_a_degree(bench: Bench, side: float, degrees: float, phase: str) -> None:
    bench.to_approach()
    exact = at(bench, 0.0)
    move(bench, 0.0)
    assert bench.run(2.0, state=replace(exact, theta_rad=side * math.radians(degrees))) == phase


@pytest.mark.parametrize("led", [0, 3])
@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize(("off", "phase"), [(0.0099, "insert"), (0.0101, "approach"), (-0.0101, "approach")])
def test_it_has_arrived_when_every_feature_is_within_its_tolerance(
    bench: Bench, led: int, axis: int, off: float, phase: str
) -> None:
    bench.to_approach()
    move(bench, 0.0)
    exact = at(bench, 0.0)
    features = [list(feature) for feature in exact.features_filtered]
    features[led][axis] += off
    shifted = tuple((a, b) for a, b in features)
    assert bench.run(2.0, state=replace(exact, features_filtered=shifted)) == phase


def test_without_filtered_features_it_has_not_arrived(bench: Bench) -> None:
    bench.to_approach()
    move(bench, 0.0)
    assert bench.run(2.0, state=replace(at(bench, 0.0), features_filtered=())) == "approach"


def test_a_pause_at_the_goal_restarts_the_settling(bench: Bench) -> None:
    bench.to_approach()
    move(bench, 0.0)
    bench.run(1.2)
    bench.step(controller_alive=False)
    bench.step(controller_alive=True)
    assert bench.run(0.55 + 1.4) == "approach"
    assert bench.run(0.3) == "insert"


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"controller_alive": False}, "unwell: controller silent"),
        ({"late": "follower-arms"}, "unwell: follower-arms runs late"),
    ],
)
def test_what_is_unwell_for_three_seconds_ends_it(bench: Bench, changes: dict[str, Any], named: str) -> None:
    bench.to_approach()
    bench.step(**changes)
    for _ in range(60):
        assert bench.step().mission.phase == "approach"
    bench.step()
    assert bench.sequence.phase == "aborted"
    assert cause(bench).startswith(named)


def test_too_few_leds_for_three_seconds_end_it(bench: Bench) -> None:
    bench.to_approach()
    assert bench.seen.state is not None
    two = (*((0.0, 0.0),) * 2, None, None)
    bench.run(5.0, state=replace(bench.seen.state, features=two))
    assert (bench.sequence.phase, cause(bench)) == ("aborted", "few_leds: too few LEDs to locate the goal")


@pytest.mark.parametrize(("wheel_m_s", "motion"), [(0.0505, "hold"), (-0.0505, "hold"), (0.0495, "servo")])
def test_slip_is_judged_above_five_centimetres_a_second(bench: Bench, wheel_m_s: float, motion: str) -> None:
    bench.to_approach()
    speed = wheel_m_s / bench.config.base.wheel_radius_m
    assert bench.seen.drives is not None
    assert bench.seen.state is not None
    slipping = replace(bench.seen.state, disturbance=(-0.545, 0.0, 0.0, 0.0))
    bench.run(0.4, drives=replace(bench.seen.drives, wheel_speed_rad_s=(speed, speed)), state=slipping)
    assert bench.mission is not None
    assert bench.mission.motion == motion


def after(bench: Bench, milliseconds: int) -> None:
    """One step so long after the last one."""
    bench.seen = replace(bench.seen, now_ns=bench.seen.now_ns + (milliseconds - 50) * NS_PER_MS)
    bench.step()


@pytest.mark.parametrize(("milliseconds", "motion"), [(290, "servo"), (300, "hold")])
def test_slip_pauses_after_300_ms_also_after_a_time_without_an_estimate(
    bench: Bench, milliseconds: int, motion: str
) -> None:
    bench.to_approach()
    state, drives = bench.seen.state, bench.seen.drives
    assert state is not None
    assert drives is not None
    bench.run(0.6, state=None)
    bench.run(0.7, state=state)
    speed = 0.2 / bench.config.base.wheel_radius_m
    slipping = replace(state, disturbance=(-0.6, 0.0, 0.0, 0.0))
    bench.step(state=slipping, drives=replace(drives, wheel_speed_rad_s=(speed, speed)))
    after(bench, milliseconds)
    assert bench.mission is not None
    assert bench.mission.motion == motion


@pytest.mark.parametrize(("milliseconds", "reduced"), [(300, False), (301, True)])
def test_a_led_is_missing_after_300_ms(bench: Bench, milliseconds: int, reduced: bool) -> None:
    bench.to_approach()
    assert bench.seen.state is not None
    whole = ((0.0, 0.0),) * 4
    bench.step(state=replace(bench.seen.state, features=whole))
    bench.seen = replace(bench.seen, state=replace(bench.seen.state, features=(*whole[:3], None)))
    after(bench, milliseconds)
    assert bench.mission is not None
    assert (bench.mission.v_max_m_s == bench.config.supervisor.reduced_speed_m_s) == reduced


def test_a_sixth_pause_without_a_reason_of_its_own_names_the_number(bench: Bench) -> None:
    bench.to_approach()
    for _ in range(6):
        bench.step(controller_alive=False)
        bench.run(0.7, controller_alive=True)
    assert (bench.sequence.phase, cause(bench)) == ("aborted", "too_many_pauses: controller silent")
