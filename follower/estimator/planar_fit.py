"""Pose of the array by Gauss–Newton on its features: x, y, θ on the floor, camera pitch and roll under a prior.

Model: eq. (featurepoint), then the camera's own tilt away from its mounting, then eq. (depthscale). A planar
fit without the tilt takes 0.3° of pitch for tens of centimetres of distance; with it as a state under a prior
the same pitch costs a few. Many hypotheses are fitted at once: identification needs it, tracking fits one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.geometry import Array, Pose2, wrap_angle

_NEAREST_M = 0.05
_MAX_STEP = np.array([1.5, 1.5, 0.5, 0.1, 0.1])


@dataclass(frozen=True)
class FitModel:
    """What the fit knows: LEDs in {L}, camera in {F}, and how much to trust what.

    Attributes:
        points_l: (n, 3) LEDs in {L} [m].
        camera_xyz_m: ξ in {F} [m].
        sigma: standard deviation of a normalised coordinate (pixels over focal length).
        tilt_sigma_rad: prior standard deviation of pitch and of roll.
    """

    points_l: Array
    camera_xyz_m: Array
    sigma: float
    tilt_sigma_rad: float


@dataclass(frozen=True)
class Fits:
    """K fitted hypotheses.

    Attributes:
        states: (K, 5) x, y [m], θ, pitch, roll [rad]; pitch positive looks up, roll positive lowers the right.
        covariance: (K, 5, 5) of the states.
        chi2: (K,) weighted squared residuals, the prior's included.
        residual: (K, n) distance between measured and modelled feature, normalised; NaN where not seen.
        in_front: (K,) whether every LED lies in front of the camera.
    """

    states: Array
    covariance: Array
    chi2: Array
    residual: Array
    in_front: NDArray[np.bool_]


@dataclass(frozen=True)
class PlanarFit:
    """One fitted pose of {L} in {F}, with the camera's tilt, (3, 3) covariance of x, y, θ and residuals."""

    pose: Pose2
    pitch_rad: float
    roll_rad: float
    covariance: Array
    covariance5: Array
    chi2: float
    residual: Array


def project(model: FitModel, states: Array) -> tuple[Array, Array, Array]:
    """Features of states (K, 5): ``(features (K, n, 2), Jacobian (K, n, 2, 5), depth (K, n))``."""
    ideal, about_theta = _ideal_points(model, states)
    x, y, z = ideal
    x_theta, z_theta = about_theta
    cp, sp = np.cos(states[:, 3:4]), np.sin(states[:, 3:4])
    cr, sr = np.cos(states[:, 4:5]), np.sin(states[:, 4:5])
    y1, z1 = y * cp + z * sp, z * cp - y * sp
    x2, y2 = x * cr + y1 * sr, y1 * cr - x * sr
    safe = np.maximum(z1, _NEAREST_M)
    features = np.stack([x2 / safe, y2 / safe], axis=2)
    # columns: derivatives of the tilted point's coordinates by x, y, θ, pitch, roll
    zero = np.zeros_like(x)
    dx2 = np.stack([sp * sr + zero, zero - cr, x_theta * cr + z_theta * sp * sr, z1 * sr, y2], axis=2)
    dy2 = np.stack([sp * cr + zero, zero + sr, z_theta * sp * cr - x_theta * sr, z1 * cr, -x2], axis=2)
    dz = np.stack([cp + zero, zero, z_theta * cp, -y1, zero], axis=2)
    jacobian = np.empty((*x.shape, 2, 5))
    jacobian[:, :, 0] = (dx2 - features[:, :, 0:1] * dz) / safe[:, :, None]
    jacobian[:, :, 1] = (dy2 - features[:, :, 1:2] * dz) / safe[:, :, None]
    return features, jacobian, z1


def fit(model: FitModel, features: Array, start: Array, iterations: int = 6) -> Fits:
    """Fit K hypotheses.

    Args:
        model: array, camera and weights.
        features: (K, n, 2) normalised, NaN where a LED is not seen.
        start: (K, 5) initial states.
        iterations: Gauss–Newton steps; it ends earlier when every step is below a micrometre.
    """
    states = start.astype(np.float64, copy=True)
    seen = np.isfinite(features[:, :, 0])
    measured = np.where(seen[:, :, None], features, 0.0)
    weight = np.where(seen, 1.0 / model.sigma**2, 0.0)
    prior = np.array([0.0, 0.0, 0.0, 1.0, 1.0]) / model.tilt_sigma_rad**2
    for _ in range(iterations):
        predicted, jacobian, _ = project(model, states)
        information, gradient = _normal_equations(measured - predicted, jacobian, weight, prior, states)
        step = np.clip(np.linalg.solve(information, gradient[:, :, None])[:, :, 0], -_MAX_STEP, _MAX_STEP)
        states += step
        if np.abs(step).max(initial=0.0) < 1e-6:
            break
    predicted, jacobian, depth = project(model, states)
    error = measured - predicted
    information, _ = _normal_equations(error, jacobian, weight, prior, states)
    squared = (error**2).sum(axis=2)
    return Fits(
        states=states,
        covariance=np.asarray(np.linalg.inv(information), dtype=np.float64),
        chi2=(squared * weight).sum(axis=1) + (states**2 * prior).sum(axis=1),
        residual=np.where(seen, np.sqrt(squared), np.nan),
        in_front=np.asarray((depth > _NEAREST_M).all(axis=1)),
    )


def fit_one(model: FitModel, features: Array, start: Array) -> PlanarFit | None:
    """Fit one hypothesis, features (n, 2) with NaN where not seen; None where it left the camera's view."""
    fits = fit(model, features[None], start[None])
    if not fits.in_front[0]:
        return None
    x, y, theta, pitch, roll = (float(value) for value in fits.states[0])
    covariance = fits.covariance[0]
    return PlanarFit(
        Pose2(x, y, wrap_angle(theta)),
        pitch,
        roll,
        covariance[:3, :3],
        covariance,
        float(fits.chi2[0]),
        fits.residual[0],
    )


def _ideal_points(model: FitModel, states: Array) -> tuple[tuple[Array, Array, Array], tuple[Array, Array]]:
    """Points in an untilted {C}, eq. (featurepoint), each (K, n), and derivatives of X and Z by θ."""
    t_x, t_y, t_z = model.camera_xyz_m
    points = model.points_l
    c, s = np.cos(states[:, 2:3]), np.sin(states[:, 2:3])
    forward = points[:, 0] * c - points[:, 1] * s
    left = points[:, 0] * s + points[:, 1] * c
    x = t_y - states[:, 1:2] - left
    y = np.broadcast_to(t_z - points[:, 2], x.shape)
    z = states[:, 0:1] - t_x + forward
    return (x, y, z), (-forward, -left)


def _normal_equations(
    error: Array, jacobian: Array, weight: Array, prior: Array, states: Array
) -> tuple[Array, Array]:
    count, points = weight.shape
    stacked = jacobian.reshape(count, points * 2, 5)
    weighted = stacked * np.repeat(weight, 2, axis=1)[:, :, None]
    information = np.matmul(weighted.transpose(0, 2, 1), stacked)
    information[:, range(5), range(5)] += prior
    gradient = np.matmul(weighted.transpose(0, 2, 1), error.reshape(count, points * 2, 1))[:, :, 0]
    return information, gradient - prior * states
