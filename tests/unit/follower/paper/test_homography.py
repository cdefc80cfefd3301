"""The paper's θ: exact where it is defined, guarded where it degenerates."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.config import Config
from common.geometry import Array, Pose2, features_at
from follower.paper.homography import array_normal, theta_from_homography


def desired(config: Config) -> Array:
    return features_at(config.leds.points, config.docking.goal(1), config.camera.mount)


@settings(max_examples=60, deadline=None)
@given(distance=st.floats(1.3, 9.0), bearing=st.floats(-0.7, 0.7), aspect=st.floats(-0.8, 0.8))
def test_exact_features_give_the_exact_heading(
    config: Config, distance: float, bearing: float, aspect: float
) -> None:
    x, y, theta = distance * np.cos(bearing), distance * np.sin(bearing), bearing + aspect
    current = features_at(config.leds.points, Pose2(x, y, theta), config.camera.mount)
    found = theta_from_homography(current, desired(config), array_normal(config.leds.points), theta)
    assert found == pytest.approx(theta, abs=2e-3)


@pytest.mark.parametrize("theta", [0.0, 0.01, -0.2])
def test_at_the_goal_a_pure_rotation_is_read_as_such(config: Config, theta: float) -> None:
    ray = np.column_stack([desired(config), np.ones(4)])
    c, s = np.cos(theta), np.sin(theta)
    turned = ray @ np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]]).T
    current = turned[:, :2] / turned[:, 2:]
    found = theta_from_homography(current, desired(config), array_normal(config.leds.points), None)
    assert found == pytest.approx(theta, abs=1e-6)


def test_normal_is_the_arrays(config: Config) -> None:
    normal = array_normal(config.leds.points)
    tilt = np.radians(40.0)
    assert normal == pytest.approx([0.0, np.sin(tilt), np.cos(tilt)], abs=1e-5)


def test_three_features_have_no_homography(config: Config) -> None:
    current = desired(config).copy()
    current[1] = np.nan
    assert theta_from_homography(current, desired(config), array_normal(config.leds.points), None) is None


def test_collinear_features_have_no_solution(config: Config) -> None:
    line = np.column_stack([np.linspace(-0.1, 0.1, 4), np.linspace(-0.3, -0.1, 4)])
    assert theta_from_homography(line, line * 1.1, array_normal(config.leds.points), None) is None


def test_the_plane_seen_from_behind_has_no_solution(config: Config) -> None:
    current = features_at(config.leds.points, Pose2(1.25, -1.5, 0.5), config.camera.mount)
    assert theta_from_homography(current, desired(config), array_normal(config.leds.points), 0.5) is None
