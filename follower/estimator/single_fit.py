"""The fit of :mod:`follower.estimator.planar_fit` for one hypothesis, in plain floats.

Four LEDs are too few for array operations to pay: this takes a quarter of the time, once per frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from common.geometry import Array, Pose2, wrap_angle
from follower.estimator.planar_fit import CONVERGED, MAX_STEP, FitModel
from follower.model.array import NEAREST_M, project_led, tilt_of

_STEPS = tuple(float(step) for step in MAX_STEP)


@dataclass(frozen=True)
class PlanarFit:
    """One fitted pose of {L} in {F}.

    Attributes:
        pose: x, y [m], θ [rad].
        pitch_rad, roll_rad: camera tilt away from its mounting, up and right side down.
        covariance: (3, 3) of x, y, θ.
        chi2: weighted squared residuals, the prior's included.
        residual: (n,) distance between measured and modelled feature, normalised; NaN where not seen.
    """

    pose: Pose2
    pitch_rad: float
    roll_rad: float
    covariance: Array
    chi2: float
    residual: Array

    @property
    def residual_rms(self) -> float:
        """Root mean square of the residual over the LEDs seen, normalised."""
        squares = [value * value for value in self.residual.tolist() if value == value]
        return math.sqrt(sum(squares) / len(squares))

    @property
    def state(self) -> Array:
        """x, y, θ, pitch, roll."""
        return np.array([self.pose.x_m, self.pose.y_m, self.pose.theta_rad, self.pitch_rad, self.roll_rad])


def features_of(model: FitModel, state: Array) -> Array:
    """Features (n, 2) of one state.

    Args:
        model: array and camera.
        state: (5,) x, y [m], θ, pitch, roll [rad].
    """
    values, mount = state.tolist(), tuple(model.camera_xyz_m.tolist())
    tilt = tilt_of(values)
    rows = [project_led(tuple(point), values, mount, tilt) for point in model.points_l.tolist()]
    return np.array([(alpha, beta) for _, _, alpha, beta, _ in rows])


def levelled(features: Array, pitch_rad: float, roll_rad: float) -> Array:
    """Features (n, 2) as the camera would see them without its tilt; NaN stays NaN.

    Args:
        features: (n, 2) normalised.
        pitch_rad: of the camera, up.
        roll_rad: of the camera, right side down.
    """
    cp, sp, cr, sr = math.cos(pitch_rad), math.sin(pitch_rad), math.cos(roll_rad), math.sin(roll_rad)
    level = []
    for alpha, beta in features.tolist():
        right, down = alpha * cr - beta * sr, alpha * sr + beta * cr
        ahead = cp + down * sp
        level.append((right / ahead, (down * cp - sp) / ahead))
    return np.array(level)


def fit_one(model: FitModel, features: Array, start: Array, iterations: int = 6) -> PlanarFit | None:
    """Fit one hypothesis.

    Once a step is below 1e-4, residuals follow it to first order and the covariance is that of before it: what
    another evaluation would change does not show in eight digits.

    Args:
        model: array, camera and weights.
        features: (n, 2) normalised, NaN where a LED is not seen.
        start: (5,) x, y [m], θ, pitch, roll [rad].
        iterations: Gauss–Newton steps at most.

    Returns:
        None where a LED left the camera's view or the LEDs seen do not determine the pose.
    """
    seen = [
        (row, alpha, beta, tuple(point))
        for row, ((alpha, beta), point) in enumerate(zip(features.tolist(), model.points_l.tolist(), strict=True))
        if alpha == alpha
    ]
    state = start.tolist()
    weight, prior = 1.0 / model.sigma**2, 1.0 / model.tilt_sigma_rad**2
    mount = tuple(model.camera_xyz_m.tolist())
    while True:
        jacobian, error, nearest = _linearised(seen, state, mount)
        covariance = _covariance(jacobian, weight, prior)
        if covariance is None:
            return None
        if iterations == 0:
            break
        iterations -= 1
        gradient = error @ jacobian * weight
        gradient[3] -= prior * state[3]
        gradient[4] -= prior * state[4]
        taken = covariance @ gradient
        step = [min(max(delta, -most), most) for delta, most in zip(taken.tolist(), _STEPS, strict=True)]
        state = [value + delta for value, delta in zip(state, step, strict=True)]
        if max(map(abs, step)) < CONVERGED:
            error -= jacobian @ taken
            break
    if not nearest > NEAREST_M:
        return None
    squares = [alpha * alpha + beta * beta for alpha, beta in error.reshape(-1, 2).tolist()]
    residual = np.full(len(features), np.nan)
    for (row, *_), square in zip(seen, squares, strict=True):
        residual[row] = math.sqrt(square)
    chi2 = weight * sum(squares) + prior * (state[3] ** 2 + state[4] ** 2)
    pose = Pose2(state[0], state[1], wrap_angle(state[2]))
    return PlanarFit(pose, state[3], state[4], covariance[:3, :3], chi2, residual)


def _linearised(
    seen: list[tuple[int, float, float, tuple[float, ...]]], state: list[float], mount: tuple[float, ...]
) -> tuple[Array, Array, float]:
    """Jacobian (2m, 5) and error (2m,) of the seen LEDs, depth of the nearest one."""
    tilt = tilt_of(state)
    jacobian: list[list[float]] = []
    error: list[float] = []
    nearest = math.inf
    for _, alpha, beta, point in seen:
        along, across, model_alpha, model_beta, depth = project_led(point, state, mount, tilt)
        jacobian += [along, across]
        error += [alpha - model_alpha, beta - model_beta]
        nearest = min(nearest, depth)
    return np.array(jacobian).reshape(-1, 5), np.array(error), nearest


def _covariance(jacobian: Array, weight: float, prior: float) -> Array | None:
    """(5, 5) of the state; None where the LEDs do not determine it."""
    information = jacobian.T @ jacobian * weight
    information[3, 3] += prior
    information[4, 4] += prior
    regular, covariance = cv2.invert(information, flags=cv2.DECOMP_CHOLESKY)  # a quarter of numpy's time
    return np.asarray(covariance, dtype=np.float64) if regular else None
