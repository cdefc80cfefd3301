"""The feature-level world against the motion and projection of the contract, and what its pads do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.config import default_config_path, load_config
from common.geometry import Pose2, features_at, move_relative
from experiments.feature_level.feature_world import Disturbances, FeatureWorld, Pads, inside_image, project
from experiments.feature_level.scenes import DISTURBANCES, random_starts

CONFIG = load_config(default_config_path())


def make(disturbances: Disturbances, start: Pose2 | None = None, noise_px: float = 0.0) -> FeatureWorld:
    return FeatureWorld(CONFIG, start or Pose2(-4.0, 0.3, 0.1), 1, disturbances, noise_px, 0.0)


@settings(max_examples=25, deadline=None)
@given(st.floats(-0.1, 0.5), st.floats(-0.6, 0.6))
def test_undisturbed_world_moves_as_the_model_without_sharing_it(v: float, w: float) -> None:
    world = make(Disturbances())
    expected = world.follower_in_leader.inverse()
    world.command = (v, w)
    for _ in range(20):
        world.advance(0.05)
        expected = move_relative(expected, v, w, 0.05)
    np.testing.assert_allclose(world.follower_in_leader.inverse().as_array(), expected.as_array(), atol=1e-5)


@given(st.floats(-8.0, -1.0), st.floats(-1.0, 1.0), st.floats(-0.6, 0.6))
def test_projection_agrees_with_the_contract(x: float, y: float, theta: float) -> None:
    pose = Pose2(x, y, theta)
    seen = CONFIG.camera.pinhole.to_pixels(features_at(CONFIG.leds.points, pose.inverse(), CONFIG.camera.mount))
    np.testing.assert_allclose(project(CONFIG, pose), seen, atol=1e-6)


def test_wheels_lag_and_fall_short_under_load() -> None:
    world = make(Disturbances(load_gain=0.85, lag_s=0.15))
    world.command = (0.2, 0.0)
    world.advance(0.15)
    assert world.wheels[0] == pytest.approx(0.85 * 0.2 * (1 - np.exp(-1.0)), rel=1e-6)


def test_pads_act_only_where_they_lie_and_on_a_robot_that_moves() -> None:
    pads = Disturbances(pads=(Pads(2.0, 3.0, sideways_m_s=0.04),))
    on, off, still = (make(pads, Pose2(x, 0.0, 0.0)) for x in (-2.9, -4.0, -2.9))
    on.command = off.command = (0.2, 0.0)
    for world in (on, off, still):
        world.advance(1.0)
    assert on.follower_in_leader.y_m == pytest.approx(0.04, rel=1e-6)
    assert off.follower_in_leader.y_m == 0.0
    assert still.follower_in_leader.y_m == 0.0


def test_drifts_fade_by_a_law_of_the_worlds_own() -> None:
    for knee, speed, share in ((None, 0.02, 1.0), (None, 0.01, 0.5), (0.05, 0.02, 0.4), (0.0, 0.001, 1.0)):
        bias = Disturbances(yaw_bias_rad_s=0.05)
        world = make(bias if knee is None else replace(bias, drift_knee_m_s=knee), Pose2(-3.0, 0.0, 0.0))
        world.command = (speed, 0.0)
        world.advance(1.0)
        assert world.follower_in_leader.theta_rad == pytest.approx(0.05 * share, rel=1e-6)


def test_no_fade_rows_are_cases_of_their_own() -> None:
    assert list(DISTURBANCES)[10:] == ["yaw_bias_no_fade", "late_pads_load_lag_bias_no_fade"]
    still = make(DISTURBANCES["yaw_bias_no_fade"], Pose2(-3.0, 0.0, 0.0))
    still.advance(1.0)
    assert still.follower_in_leader.theta_rad == 0.0


def test_what_is_out_of_the_image_is_not_measured() -> None:
    world = make(Disturbances(), Pose2(-2.5, 0.0, 1.0))
    inside = world.in_view()
    assert not inside.all()
    np.testing.assert_array_equal(np.isfinite(world.measure(0).features[:, 0]), inside)


def test_starts_are_in_view_and_the_same_for_a_seed() -> None:
    starts = random_starts(CONFIG, "W", 30, 4)
    assert all(inside_image(CONFIG, project(CONFIG, start)).all() for start in starts)
    assert starts == random_starts(CONFIG, "W", 30, 4)
    assert starts != random_starts(CONFIG, "W", 30, 5)
