"""Planar fit: exact Jacobian, exact pose, honest covariance."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.config import Config
from common.geometry import Pose2, features_at
from follower.estimator.planar_fit import FitModel, fit, project
from follower.estimator.single_fit import features_of, fit_one, levelled

SIGMA = 0.2 / 369.5


def model(config: Config, sigma: float = SIGMA) -> FitModel:
    return FitModel(config.leds.points, config.camera.mount, sigma, math.radians(0.7))


def test_exact_features_give_the_exact_pose(config: Config) -> None:
    truth = Pose2(4.0, 0.6, -0.3)
    features = features_at(config.leds.points, truth, config.camera.mount)
    fitted = fit_one(model(config), features, np.array([4.5, 0.2, 0.0, 0.0, 0.0]))
    assert fitted is not None
    assert fitted.pose.as_array() == pytest.approx(truth.as_array(), abs=1e-6)
    assert fitted.chi2 == pytest.approx(0.0, abs=1e-6)


def test_tilt_as_a_state_keeps_the_distance(config: Config) -> None:
    """0.3° of pitch at 6 m: a planar fit alone is off by tens of centimetres."""
    truth = np.array([[6.0, 0.0, 0.0, math.radians(0.3), 0.0]])
    features = project(model(config), truth)[0][0]
    with_tilt = fit_one(model(config), features, np.array([6.0, 0.0, 0.0, 0.0, 0.0]))
    stiff = FitModel(config.leds.points, config.camera.mount, SIGMA, 1e-6)
    without = fit_one(stiff, features, np.array([6.0, 0.0, 0.0, 0.0, 0.0]))
    assert with_tilt is not None
    assert without is not None
    assert abs(with_tilt.pose.x_m - 6.0) < 0.05
    assert abs(without.pose.x_m - 6.0) > 4 * abs(with_tilt.pose.x_m - 6.0)


def test_covariance_is_the_scatter_of_the_fits(config: Config) -> None:
    rng = np.random.default_rng(5)
    truth = np.array([5.0, 0.4, 0.2, 0.0, 0.0])
    clean = project(model(config), truth[None])[0]
    trials = 1500
    tilts = rng.normal(0.0, math.radians(0.7), (trials, 2))
    states = np.column_stack([np.tile(truth[:3], (trials, 1)), tilts])
    features = project(model(config), states)[0] + rng.normal(0.0, SIGMA, (trials, *clean.shape[1:]))
    fits = fit(model(config), features, np.tile(truth, (trials, 1)))
    scatter = np.std(fits.states[:, :3], axis=0)
    promised = np.sqrt(np.diag(fits.covariance[0]))[:3]
    assert scatter == pytest.approx(promised, rel=0.12)


def test_a_missing_led_still_gives_the_pose(config: Config) -> None:
    truth = Pose2(3.0, -0.4, 0.2)
    features = features_at(config.leds.points, truth, config.camera.mount)
    features[2] = np.nan
    fitted = fit_one(model(config), features, np.array([3.2, -0.3, 0.1, 0.0, 0.0]))
    assert fitted is not None
    assert fitted.pose.as_array() == pytest.approx(truth.as_array(), abs=1e-6)
    assert np.isnan(fitted.residual[2])


def test_a_fit_that_leaves_the_view_is_refused(config: Config) -> None:
    features = np.array([[9.0, 9.0], [-9.0, 9.0], [9.0, -9.0], [-9.0, -9.0]])
    assert fit_one(model(config), features, np.array([-3.0, 0.0, 0.0, 0.0, 0.0])) is None


@settings(max_examples=30, deadline=None)
@given(x=st.floats(1.3, 9.0), y=st.floats(-1.0, 1.0), theta=st.floats(-0.7, 0.7), seed=st.integers(0, 99))
def test_one_and_many_agree(config: Config, x: float, y: float, theta: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth = np.array([x, y, theta, *rng.normal(0.0, 0.01, 2)])
    features = project(model(config), truth[None])[0] + rng.normal(0.0, SIGMA, (1, 4, 2))
    start = truth + rng.normal(0.0, 0.03, 5)
    many = fit(model(config), features, start[None], iterations=12)
    one = fit_one(model(config), features[0], start, iterations=12)
    assert one is not None
    assert features_of(model(config), truth) == pytest.approx(project(model(config), truth[None])[0][0], abs=1e-12)
    assert one.state == pytest.approx(many.states[0], abs=2e-4)
    assert one.chi2 == pytest.approx(float(many.chi2[0]), rel=1e-3, abs=1e-3)
    assert one.covariance == pytest.approx(many.covariance[0, :3, :3], rel=0.02, abs=1e-12)
    assert one.residual == pytest.approx(many.residual[0], abs=1e-6)


def test_levelled_features_are_those_of_an_untilted_camera(config: Config) -> None:
    tilted = features_of(model(config), np.array([4.0, 0.5, 0.2, 0.03, -0.04]))
    level = features_of(model(config), np.array([4.0, 0.5, 0.2, 0.0, 0.0]))
    assert levelled(tilted, 0.03, -0.04) == pytest.approx(level, abs=1e-12)
    tilted[1] = np.nan
    assert np.isnan(levelled(tilted, 0.03, -0.04)[1]).all()
