"""Frames, projection and the interaction matrix against what they are derivatives and inverses of."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.config import Config
from common.geometry import (
    Pinhole,
    Pose2,
    extended_interaction_matrix,
    features_at,
    interaction_matrix,
    mirror_deviation_m,
    move_relative,
    pose_from_paper_start,
    wrap_angle,
)

POSES = st.builds(Pose2, st.floats(-9, 9), st.floats(-9, 9), st.floats(-3.1, 3.1))
IN_VIEW = st.builds(Pose2, st.floats(1.3, 8.0), st.floats(-1.0, 1.0), st.floats(-0.6, 0.6))
POINTS = np.array([[-0.16, -0.28, 1.38], [-0.14, 0.28, 1.40], [0.19, 0.10, 1.80], [0.12, -0.24, 1.72]])
MOUNT = np.array([0.25, 0.07, 1.20])


def close(a: Pose2, b: Pose2, tolerance: float = 1e-9) -> bool:
    return (
        math.isclose(a.x_m, b.x_m, abs_tol=tolerance)
        and math.isclose(a.y_m, b.y_m, abs_tol=tolerance)
        and abs(wrap_angle(a.theta_rad - b.theta_rad)) < tolerance
    )


@given(POSES)
def test_a_pose_and_its_inverse_cancel(pose: Pose2) -> None:
    assert close(pose.compose(pose.inverse()), Pose2(0, 0, 0))
    assert close(pose.inverse().inverse(), pose)


@given(POSES, POSES, POSES)
def test_composition_is_associative(a: Pose2, b: Pose2, c: Pose2) -> None:
    assert close(a.compose(b).compose(c), a.compose(b.compose(c)), 1e-7)


@given(st.floats(-50, 50))
def test_wrapped_angles_are_the_same_direction(angle: float) -> None:
    wrapped = wrap_angle(angle)
    assert -math.pi < wrapped <= math.pi
    assert math.isclose(math.cos(wrapped), math.cos(angle), abs_tol=1e-9)
    assert math.isclose(math.sin(wrapped), math.sin(angle), abs_tol=1e-9)


@given(IN_VIEW, st.floats(-0.5, 0.5), st.floats(-0.6, 0.6))
def test_interaction_matrix_is_the_derivative_of_the_projection(pose: Pose2, v: float, w: float) -> None:
    heights = MOUNT[2] - POINTS[:, 2]
    features = features_at(POINTS, pose, MOUNT)
    step = 1e-5
    ahead = features_at(POINTS, move_relative(pose, v, w, step), MOUNT)
    behind = features_at(POINTS, move_relative(pose, v, w, -step), MOUNT)
    rates = interaction_matrix(features, heights, MOUNT) @ np.array([v, w])
    np.testing.assert_allclose(rates, (ahead - behind) / (2 * step), atol=1e-7)


@given(IN_VIEW)
def test_extended_matrix_stacks_the_points_and_ends_with_the_heading(pose: Pose2) -> None:
    features = features_at(POINTS, pose, MOUNT)
    heights = MOUNT[2] - POINTS[:, 2]
    stacked = extended_interaction_matrix(features, heights, MOUNT)
    assert stacked.shape == (9, 2)
    np.testing.assert_array_equal(stacked[2:4], interaction_matrix(features, heights, MOUNT)[1])
    np.testing.assert_array_equal(stacked[-1], [0.0, -1.0])


@given(IN_VIEW, st.floats(-0.4, 0.4), st.floats(-0.6, 0.6))
def test_moving_in_two_halves_is_moving_once(pose: Pose2, v: float, w: float) -> None:
    twice = move_relative(move_relative(pose, v, w, 0.4), v, w, 0.4)
    assert close(twice, move_relative(pose, v, w, 0.8))


def test_driving_forward_brings_the_leader_nearer_and_turning_left_moves_it_right() -> None:
    assert move_relative(Pose2(5, 0, 0), 0.5, 0.0, 1.0).x_m == pytest.approx(4.5)
    turned = move_relative(Pose2(5, 0, 0), 0.0, 0.1, 1.0)
    assert turned.y_m < 0
    assert turned.theta_rad == pytest.approx(-0.1)


def test_the_array_at_the_first_goal_stands_where_the_design_says(config: Config) -> None:
    pixels = config.camera.pinhole.to_pixels(
        features_at(config.leds.points, config.docking.goal(1), config.camera.mount)
    )
    np.testing.assert_allclose(pixels, [[735, 451], [546, 445], [614, 358], [705, 372]], atol=0.6)


@pytest.mark.parametrize("start", [(6, 1.5, 0), (8, 1, -30), (7, -0.5, -45), (4, -1, 45), (6.2, 1.6, -45)])
def test_all_starts_of_the_paper_have_the_leds_in_view(config: Config, start: tuple[float, float, float]) -> None:
    relative = pose_from_paper_start(start[0], start[1], math.radians(start[2])).inverse()
    pixels = config.camera.pinhole.to_pixels(features_at(config.leds.points, relative, config.camera.mount))
    assert (pixels >= 0).all()
    assert (pixels <= [1279, 1023]).all()


def test_points_behind_the_camera_have_no_image() -> None:
    with pytest.raises(ValueError, match="behind the camera"):
        features_at(POINTS, Pose2(-1.0, 0.0, 0.0), MOUNT)


@given(st.floats(-2, 2), st.floats(-2, 2))
def test_pixels_and_normalised_coordinates_round_trip(alpha: float, beta: float) -> None:
    pinhole = Pinhole(369.5, 371.0, 640.0, 512.0, 1280, 1024)
    point = np.array([[alpha, beta]])
    np.testing.assert_allclose(pinhole.to_normalised(pinhole.to_pixels(point)), point, atol=1e-12)
    homogeneous = pinhole.matrix() @ [alpha, beta, 1.0]
    np.testing.assert_allclose(homogeneous[:2], pinhole.to_pixels(point)[0])


def test_mirror_deviation_tells_symmetric_arrays_from_others(config: Config) -> None:
    square = np.array([[0.0, y, z] for y in (-0.2, 0.2) for z in (1.4, 1.8)])
    turned = square @ np.array([[0.8, 0.6, 0.0], [-0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    assert mirror_deviation_m(square) == pytest.approx(0.0, abs=1e-9)
    assert mirror_deviation_m(turned) == pytest.approx(0.0, abs=1e-9)
    vertical = config.leds.points * [0.0, 1.0, 1.0]
    assert mirror_deviation_m(config.leds.points) > 0.1
    assert mirror_deviation_m(vertical) > 0.09
