"""The relative observer: its derivatives, its accuracy and consistency, and what it refuses."""

from __future__ import annotations

from dataclasses import astuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.config import Config, default_config_path, load_config
from common.geometry import Array, Pose2, features_at, move_relative
from follower.estimator.observer import GATE_CHI2, RelativeObserver, _gate, _inverse
from follower.model.motion import MotionDisturbance, advance

CONFIG = load_config(default_config_path())
POINTS, CAMERA = CONFIG.leds.points, CONFIG.camera.mount
SIGMA = 3.0 / CONFIG.camera.lens.fx_px
FRAME_NS = 16_666_667


def make(config: Config = CONFIG) -> RelativeObserver:
    return RelativeObserver(POINTS, CAMERA, config.estimator)


def features(pose: Pose2) -> Array:
    return features_at(POINTS, pose, CAMERA)


poses = st.builds(Pose2, st.floats(1.3, 8.0), st.floats(-1.0, 1.0), st.floats(-0.6, 0.6))


disturbances = st.builds(
    MotionDisturbance, st.floats(-0.3, 0.3), st.floats(-0.4, 0.4), st.floats(-0.1, 0.1), st.floats(-0.05, 0.05)
)


def stacked(pose: Pose2, disturbance: MotionDisturbance) -> Array:
    return np.concatenate([pose.as_array(), astuple(disturbance)])


@given(poses, disturbances, st.floats(-0.1, 0.5), st.floats(-0.6, 0.6))
def test_transition_is_the_derivative(pose: Pose2, disturbance: MotionDisturbance, v: float, w: float) -> None:
    state, step = stacked(pose, disturbance), 1e-6
    transition = advance(state, v, w, 0.05)[1]
    for i, axis in enumerate(np.eye(7)):
        slope = (advance(state + step * axis, v, w, 0.05)[0] - advance(state - step * axis, v, w, 0.05)[0]) / (
            2 * step
        )
        np.testing.assert_allclose(transition[:, i], slope, atol=1e-7)


@given(poses, st.floats(-0.1, 0.5), st.floats(-0.6, 0.6))
def test_undisturbed_motion_is_the_exact_one(pose: Pose2, v: float, w: float) -> None:
    moved = advance(stacked(pose, MotionDisturbance()), v, w, 1 / 60)[0]
    np.testing.assert_allclose(moved[:3], move_relative(pose, v, w, 1 / 60).as_array(), atol=1e-7)


def run(observer: RelativeObserver, truth: Pose2, frames: int, seed: int, v: float = 0.1, w: float = 0.02) -> Pose2:
    """Drive along and observe; returns the true pose at the end."""
    rng = np.random.default_rng(seed)
    for k in range(1, frames + 1):
        truth = move_relative(truth, v, w, FRAME_NS * 1e-9)
        observer.predict(k * FRAME_NS, v, w)
        observer.update(features(truth) + SIGMA * rng.standard_normal((len(POINTS), 2)), SIGMA)
    return truth


def test_filtering_beats_one_frame_by_far_and_the_covariance_tells_how_far() -> None:
    normalised = []
    for seed in range(20):
        observer = make()
        observer.reset(Pose2(3.2, 0.3, 0.15), np.diag([0.04, 0.04, 0.01]), 0)
        truth = run(observer, Pose2(3.0, 0.2, 0.1), 240, seed)
        error = observer.pose.as_array() - truth.as_array()
        normalised.append(error @ np.linalg.solve(observer.covariance, error))
        assert abs(error[1]) < 0.02
    assert 1.0 < np.mean(normalised) < 5.0  # three degrees of freedom


def test_an_outlier_is_refused_and_the_rest_used() -> None:
    observer, pose = make(), Pose2(2.0, 0.0, 0.0)
    observer.reset(pose, 1e-4 * np.eye(3), 0)
    seen = features(pose)
    seen[1] += 0.3
    used = observer.update(seen, SIGMA)
    assert used.tolist() == [True, False, True, True]
    np.testing.assert_allclose(observer.pose.as_array(), pose.as_array(), atol=1e-9)


def test_unseen_points_are_left_out() -> None:
    observer, pose = make(), Pose2(2.0, 0.0, 0.0)
    observer.reset(pose, 1e-2 * np.eye(3), 0)
    before = observer.covariance
    nothing = np.full((4, 2), np.nan)
    assert not observer.update(nothing, SIGMA).any()
    np.testing.assert_array_equal(observer.covariance, before)
    seen = features(pose)
    seen[0] = np.nan
    assert observer.update(seen, SIGMA).tolist() == [False, True, True, True]
    assert np.trace(observer.covariance) < np.trace(before)


def test_time_does_not_go_back() -> None:
    observer = make()
    observer.reset(Pose2(2.0, 0.0, 0.0), np.eye(3), 100)
    with pytest.raises(ValueError, match="cannot go back"):
        observer.predict(99, 0.0, 0.0)


def test_pose_at_is_where_the_wheels_bring_it() -> None:
    observer = make()
    observer.reset(Pose2(3.0, 0.2, 0.1), np.eye(3), 0)
    expected = move_relative(Pose2(3.0, 0.2, 0.1), 0.3, -0.2, 0.05)
    ahead = observer.pose_at(50_000_000, 0.3, -0.2)
    np.testing.assert_allclose(ahead.as_array(), expected.as_array())


def drive(
    observer: RelativeObserver, disturbance: MotionDisturbance, frames: range, truth: Pose2, seed: int
) -> tuple[Pose2, list[MotionDisturbance]]:
    """Drive with a disturbance that the wheels do not tell; true pose at the end, and every estimate."""
    random, estimates, v, w = np.random.default_rng(seed), [], 0.2, 0.05
    for k in frames:
        truth = Pose2(*advance(stacked(truth, disturbance), v, w, FRAME_NS * 1e-9)[0][:3])
        observer.predict(k * FRAME_NS, v, w)
        observer.update(features(truth) + SIGMA * random.standard_normal((len(POINTS), 2)), SIGMA)
        estimates.append(observer.disturbance)
    return truth, estimates


def started(truth: Pose2) -> RelativeObserver:
    observer = make()
    observer.reset(truth, np.diag([1e-3, 1e-3, 1e-4]), 0)
    return observer


def test_yaw_disturbance_is_found_and_forgotten_when_it_ends() -> None:
    truth = Pose2(3.5, 0.1, 0.0)
    observer = started(truth)
    truth, quiet = drive(observer, MotionDisturbance(), range(1, 120), truth, 1)
    assert max(abs(estimate.yaw_rad_s) for estimate in quiet) < 0.02
    truth, shaken = drive(observer, MotionDisturbance(yaw_rad_s=0.08), range(120, 300), truth, 2)
    bearing_rate = 0.08  # yaw and drift together must explain how fast the array wanders through the image
    last = shaken[-1]
    range_m = truth.x_m - CAMERA[0]
    assert last.yaw_rad_s + 0.05 * last.turn_gain + last.sideways_m_s / range_m == pytest.approx(
        bearing_rate, abs=0.03
    )
    truth, after = drive(observer, MotionDisturbance(), range(300, 480), truth, 3)
    assert abs(after[-1].yaw_rad_s) < 0.01
    error = observer.pose.inverse().as_array() - truth.inverse().as_array()
    assert np.abs(error[:2]).max() < 0.05


def test_estimate_of_the_disturbance_is_bounded() -> None:
    truth = Pose2(6.0, 0.0, 0.0)
    observer = started(truth)
    _, estimates = drive(observer, MotionDisturbance(0.0, 0.0, 0.5, 0.2), range(1, 120), truth, 4)
    bound = CONFIG.estimator.disturbance.bound
    assert all(np.all(np.abs(astuple(estimate)) <= bound) for estimate in estimates)


def test_standing_still_is_no_disturbance() -> None:
    truth, random = Pose2(2.0, 0.0, 0.0), np.random.default_rng(5)
    observer = started(truth)
    for k in range(1, 600):
        observer.predict(k * FRAME_NS, 0.0, 0.0)
        observer.update(features(truth) + SIGMA * random.standard_normal((len(POINTS), 2)), SIGMA)
    assert np.abs(astuple(observer.disturbance)).max() < 0.01
    assert abs(observer.pose.inverse().y_m - truth.inverse().y_m) < 0.01


def test_a_separate_heading_is_used() -> None:
    observer, pose = make(), Pose2(2.0, 0.0, 0.0)
    observer.reset(pose, np.diag([1e-2, 1e-2, 1e-2]), 0)
    before = observer.covariance[2, 2]
    observer.update(np.full((4, 2), np.nan), SIGMA, heading=(0.05, 0.05))
    assert observer.covariance[2, 2] < 0.3 * before
    assert 0.0 < observer.pose.theta_rad < 0.05


def test_with_a_separate_heading_the_features_correct_the_place_alone() -> None:
    observer, truth = make(), Pose2(2.0, 0.1, 0.05)
    observer.reset(Pose2(2.05, 0.05, 0.0), np.diag([1e-2, 1e-2, 1e-2]), 0)
    for k in range(1, 60):
        observer.predict(k * FRAME_NS, 0.0, 0.0)
        observer.update(features(truth), SIGMA, heading=(0.02, 0.05))
    assert observer.pose.theta_rad == pytest.approx(0.02, abs=2e-3)
    assert observer.pose.x_m == pytest.approx(truth.x_m, abs=0.03)
    assert observer.pose.y_m == pytest.approx(truth.y_m, abs=0.03)


def test_inverse_and_determinant_are_those_of_linear_algebra() -> None:
    matrices = np.random.default_rng(2).standard_normal((20, 3, 3))
    inverse, determinant = _inverse(matrices)
    np.testing.assert_allclose(inverse, np.linalg.inv(matrices), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(determinant, np.linalg.det(matrices), rtol=1e-9)


def test_what_one_history_must_refuse_the_gate_weighs_by_the_uncertainty_of_each() -> None:
    """Two histories at one place, one sure of it and one not: the same point is an outlier to the first alone."""
    slopes = np.tile(np.random.default_rng(3).standard_normal((1, 8, 3)), (2, 1, 1))
    covariances = np.stack([1e-6 * np.eye(3), 1e3 * np.eye(3)])
    visible = np.array([True, True, True, False])
    residual = np.zeros((2, 8))
    near, chi2 = _gate(residual, slopes, covariances, visible)
    assert near.tolist() == [visible.tolist()] * 2
    np.testing.assert_array_equal(chi2, 0.0)
    residual[:, 1] = 1.2 * np.sqrt(GATE_CHI2)
    used, chi2 = _gate(residual, slopes, covariances, visible)
    assert used.tolist() == [[True, False, True, False], visible.tolist()]
    np.testing.assert_allclose(chi2, [GATE_CHI2, 1.2**2 * GATE_CHI2])
