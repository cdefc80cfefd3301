"""What pauses a docking, what is searched for meanwhile, and what goes on afterwards."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from common.config import Config
from common.geometry import Pose2
from common.messages import DockingState, LeaderState, Mission
from follower.supervisor.image_trust import NOT_FOLLOWING
from tests.rigs.supervisor_rig import DRIVES, LEADER, Bench, docking_state


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
    assert bench.mission.cause == "leds_lost: too close for a search"


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
    assert (bench.mission.motion, bench.mission.armed, bench.mission.waiting) == ("hold", True, NOT_FOLLOWING)
    bench.run(0.6, drives=drives)
    assert bench.mission.motion == "servo"
    waiting = [bench.step(drives=replace(rolling, measured_ns=0)).mission.waiting for _ in range(23)]
    # the estimator has time to learn that it is over
    assert 18 <= waiting.index(NOT_FOLLOWING) <= 21


def not_following(bench: Bench, config: Config) -> Mission:
    return bench.step(
        state=replace(docking_state(config, Pose2(5, 0, 0), valid=False), cause="not_following")
    ).mission


def motion(bench: Bench) -> str:
    assert bench.mission is not None
    return bench.mission.motion


def in_view(config: Config, pose: Pose2) -> DockingState:
    """The array at this pose, with the features that were seen."""
    state = docking_state(config, pose)
    return replace(state, features=state.features_filtered)


def turn(bench: Bench, config: Config, share: float, heading_rad: float = 0.0) -> float:
    """Turn as commanded until it no longer is, at most 3 s; the image turns by that share. The heading turned to."""
    drives = bench.seen.drives
    assert drives is not None
    for _ in range(60):
        mission = bench.mission
        if mission is None or mission.motion != "turn" or mission.phase != "approach":
            break
        assert mission.v_max_m_s == 0.0
        heading_rad += mission.turn_rate_rad_s / 20
        angle = heading_rad * config.base.track_m / 2 / config.base.wheel_radius_m
        seen = share * heading_rad
        pose = Pose2(5 * math.cos(seen), -5 * math.sin(seen), -seen)
        bench.step(drives=replace(drives, wheel_angle_rad=(-angle, angle)), state=in_view(config, pose))
    return heading_rad


def test_an_image_that_does_not_follow_the_wheels_is_believed_again_once_it_follows_a_turn(
    bench: Bench, config: Config
) -> None:
    bench.to_approach()
    valid, heading_rad = in_view(config, Pose2(5, 0, 0)), 0.0
    for _ in range(3):
        paused = not_following(bench, config)
        assert (paused.motion, paused.armed, paused.waiting) == ("hold", True, NOT_FOLLOWING)
        bench.step(state=docking_state(config, Pose2(5, 0, 0), valid=False))
        assert motion(bench) == "hold"
        bench.step(state=valid)
        assert motion(bench) == "turn"
        heading_rad = turn(bench, config, 1.0, heading_rad)
        assert abs(heading_rad) < 0.05
        bench.run(0.6)
        assert motion(bench) == "servo"
        assert bench.seen.state is not None
        valid = bench.seen.state


@pytest.mark.parametrize("share", [0.0, 0.2])
def test_an_image_that_stands_while_the_robot_turns_ends_the_docking(
    bench: Bench, config: Config, share: float
) -> None:
    bench.to_approach()
    not_following(bench, config)
    bench.step(state=in_view(config, Pose2(5, 0, 0)))
    assert motion(bench) == "turn"
    assert abs(turn(bench, config, share)) < 0.045
    assert bench.mission is not None
    assert (bench.sequence.phase, bench.mission.cause) == ("aborted", f"not_following: {NOT_FOLLOWING}")


def test_in_contact_an_image_that_did_not_follow_is_not_believed_again(bench: Bench, config: Config) -> None:
    bench.to_push()
    valid = bench.seen.state
    assert not_following(bench, config).motion == "hold"
    bench.run(1.0, state=valid)
    assert motion(bench) == "hold"
    bench.run(3.0)
    assert bench.mission is not None
    assert (bench.sequence.phase, bench.mission.cause) == ("aborted", f"not_following: {NOT_FOLLOWING}")


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
