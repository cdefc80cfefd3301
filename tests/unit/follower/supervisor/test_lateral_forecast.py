"""How well the goal is known sideways, by the LEDs that are seen."""

from __future__ import annotations

import math

import numpy as np
import pytest

from common.config import Config
from common.geometry import Pose2, features_at
from follower.supervisor.lateral_forecast import LateralForecast, settled_sigma_m


def test_three_leds_tell_the_goal_less_well_than_four(config: Config) -> None:
    goal = config.docking.goal(1)
    four = settled_sigma_m(config, goal, ())
    three = [settled_sigma_m(config, goal, (led,)) for led in range(4)]
    assert 0.0 < four < min(three)
    assert settled_sigma_m(config, goal, (0, 1)) == math.inf


def settled(config: Config, missing: tuple[int, ...]) -> float:
    """The same by the gain form of the filter, until nothing changes; the goal's distance is the heading's lever."""
    goal = config.docking.goal(1)
    remaining = [led for led in range(4) if led not in missing]
    rows = []
    for axis in range(3):
        shift = [0.0, 0.0, 0.0]
        shift[axis] = 1e-6
        moved = [
            features_at(
                config.leds.points[remaining],
                Pose2(goal.x_m + sign * shift[0], goal.y_m + sign * shift[1], goal.theta_rad + sign * shift[2]),
                config.camera.mount,
            ).ravel()
            for sign in (1.0, -1.0)
        ]
        rows.append((moved[0] - moved[1]) / 2e-6)
    jacobian = np.array(rows).T
    sigma = config.estimator.pixel_sigma_px / config.camera.lens.fx_px
    pitch = np.tile([0.0, 1.0], len(remaining))
    noise = sigma**2 * np.eye(len(jacobian)) + 0.01**2 * np.outer(pitch, pitch)
    growth = np.diag(np.square(config.estimator.process_noise)) / config.camera.rate_hz
    covariance = np.eye(3)
    for _ in range(5000):
        predicted = covariance + growth
        gain = predicted @ jacobian.T @ np.linalg.inv(jacobian @ predicted @ jacobian.T + noise)
        covariance = (np.eye(3) - gain @ jacobian) @ predicted
    lever = np.array([0.0, -1.0, goal.x_m])
    return float(np.sqrt(lever @ covariance @ lever))


@pytest.mark.parametrize("missing", [(), (0,), (1,), (2,), (3,)])
def test_it_is_what_a_kalman_filter_settles_at(config: Config, missing: tuple[int, ...]) -> None:
    goal = config.docking.goal(1)
    assert settled_sigma_m(config, goal, missing) == pytest.approx(settled(config, missing), rel=3e-3)


def test_it_is_computed_once_for_each_set_of_missing_leds(config: Config) -> None:
    forecast = LateralForecast(config, config.docking.goal(1))
    for missing in ((), (0,), ()):
        assert forecast.sigma_m(missing) == settled_sigma_m(config, config.docking.goal(1), missing)
