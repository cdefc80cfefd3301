"""How well the array's image determines the pose: the Cramér–Rao bound, and both routes' scatter beside it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from common.config import Config
from common.geometry import Array, Pose2, features_at, wrap_angle
from follower.estimator.planar_fit import FitModel
from follower.estimator.single_fit import fit_one
from follower.paper.homography import array_normal, theta_from_homography

GROSS_RAD = math.radians(15.0)
START_SIGMA = (0.3, 0.1, math.radians(6.0))  # of the fits' starts about the truth: m, m, rad


@dataclass(frozen=True)
class ThetaError:
    """Heading errors at one distance [degrees]: the bound, both routes, and their shares of failures.

    A fit fails that does not converge; the homography's share is of those above 15° or without a solution.
    """

    distance_m: float
    bound_deg: float
    planar_fit_deg: float
    planar_fit_failed_percent: float
    homography_deg: float
    homography_gross_percent: float


def pose_bound(config: Config, relative: Pose2, sigma_px: float) -> Array:
    """Cramér–Rao bound of the standard deviations of x, y [m], θ [rad] for a camera that does not tilt.

    Independent of the estimator's Jacobian: central differences of eq. (4) and eq. (7), the projection.
    """
    points, mount = config.leds.points, config.camera.mount
    step = 1e-6
    columns = []
    for delta in np.eye(3) * step:
        ahead = features_at(points, _moved(relative, delta), mount)
        behind = features_at(points, _moved(relative, -delta), mount)
        columns.append(((ahead - behind) / (2 * step)).ravel())
    jacobian = np.stack(columns, axis=1) * (config.camera.lens.fx_px / sigma_px)
    bound: Array = np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    return bound


def theta_errors(
    config: Config, distances_m: tuple[float, ...], sigma_px: float, trials: int, seed: int
) -> list[ThetaError]:
    """Scatter of θ over noisy features on the array's axis, at each distance; no fit starts at the truth.

    Args:
        config: the robots.
        distances_m: from {F} to {L}.
        sigma_px: standard deviation of a coordinate.
        trials: at each distance.
        seed: random seed.
    """
    focal, mount = config.camera.lens.fx_px, config.camera.mount
    model = FitModel(config.leds.points, mount, sigma_px / focal, math.radians(0.7))
    desired = features_at(config.leds.points, config.docking.goal(1), mount)
    normal = array_normal(config.leds.points)
    draws = np.random.default_rng(seed)
    errors = []
    for distance in distances_m:
        truth = Pose2(distance, 0.0, 0.0)
        features = features_at(config.leds.points, truth, mount)
        fitted, decomposed = [], []
        for _ in range(trials):
            noisy = features + draws.normal(0.0, sigma_px / focal, features.shape)
            start = truth.as_array() + draws.normal(0.0, START_SIGMA)
            fit = fit_one(model, noisy, np.array([*start, 0.0, 0.0]), iterations=10)
            theta = theta_from_homography(noisy, desired, normal, 0.0)
            if fit is not None:
                fitted.append(fit.pose.theta_rad)
            if theta is not None:
                decomposed.append(wrap_angle(theta))
        errors.append(
            ThetaError(
                distance,
                math.degrees(pose_bound(config, truth, sigma_px)[2]),
                math.degrees(_rms(fitted)),
                100.0 * (1.0 - len(fitted) / trials),
                math.degrees(_rms(decomposed)),
                100.0 * (1.0 - float(np.sum(np.abs(decomposed) <= GROSS_RAD)) / trials),
            )
        )
    return errors


def _moved(relative: Pose2, delta: Array) -> Pose2:
    return Pose2(relative.x_m + delta[0], relative.y_m + delta[1], relative.theta_rad + delta[2])


def _rms(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
