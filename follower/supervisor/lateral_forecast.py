"""Lateral uncertainty at the goal that the remaining LEDs allow: ``docs/safety.md`` S10."""

from __future__ import annotations

import math

import numpy as np

from common.config import Config
from common.geometry import Array, Pose2
from follower.model.array import feature_jacobian

_STEPS = 600
_FRAME_TILT_RAD = 0.01  # of the camera on its suspension: uncertainty of pitch and roll


class LateralForecast:
    """Predicted σ of e_y at the goal with LEDs missing; computed once per set of missing LEDs."""

    def __init__(self, config: Config, goal: Pose2) -> None:
        self._config, self._goal = config, goal
        self._known: dict[tuple[int, ...], float] = {}

    def sigma_m(self, missing: tuple[int, ...]) -> float:
        """Standard deviation of e_y [m] of a filter that has settled at the goal without these LEDs."""
        if missing not in self._known:
            self._known[missing] = settled_sigma_m(self._config, self._goal, missing)
        return self._known[missing]


def settled_sigma_m(config: Config, goal: Pose2, missing: tuple[int, ...]) -> float:
    """See :meth:`LateralForecast.sigma_m`; infinite for fewer than three LEDs.

    The steady state of a Kalman filter of x, y, θ with the configured process and pixel noise at the camera's rate,
    by iterating its Riccati equation; e_y of {F} in {L} follows from y and θ with the goal's distance as a lever.
    """
    remaining = [led for led in range(len(config.leds.points)) if led not in missing]
    if len(remaining) < 3:
        return math.inf
    jacobian = feature_jacobian(config.leds.points[remaining], goal, config.camera.mount)
    sigma = config.estimator.pixel_sigma_px / config.camera.lens.fx_px
    noise: Array = np.eye(len(jacobian)) * sigma**2
    by_pitch = np.zeros(len(jacobian))
    by_pitch[1::2] = 1.0  # a pitch shifts every β alike
    noise += _FRAME_TILT_RAD**2 * np.outer(by_pitch, by_pitch)
    information = jacobian.T @ np.linalg.solve(noise, jacobian)
    growth = np.diag(np.square(config.estimator.process_noise)) / config.camera.rate_hz
    covariance: Array = np.eye(3)
    for _ in range(_STEPS):
        covariance = np.linalg.inv(np.linalg.inv(covariance + growth) + information)
    lever = np.array([0.0, -1.0, goal.x_m])
    return math.sqrt(float(lever @ covariance @ lever))
