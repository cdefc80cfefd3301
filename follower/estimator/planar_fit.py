"""Pose of the array by Gauss–Newton on its features: x, y, θ on the floor, camera pitch and roll under a prior.

Model: eq. (featurepoint), then the camera's own tilt away from its mounting, then eq. (depthscale). A planar
fit without the tilt takes 0.3° of pitch for tens of centimetres of distance; with it as a state under a prior
the same pitch costs a few. Many hypotheses are fitted at once, as identification needs it;
:mod:`follower.estimator.single_fit` does the same for one, several times faster.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.geometry import Array

NEAREST_M = 0.05
CONVERGED = 1e-4
MAX_STEP = np.array([1.5, 1.5, 0.5, 0.1, 0.1])


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


def project(model: FitModel, states: Array) -> tuple[Array, Array, Array]:
    """Features of states (K, 5): ``(features (K, n, 2), Jacobian (K, n, 2, 5), depth (K, n))``."""
    image, jacobian, depth = _image(model, states)
    count, leds = depth.shape
    features = image.reshape(count, 2, leds).transpose(0, 2, 1)
    return features, jacobian.reshape(count, 2, leds, 5).transpose(0, 2, 1, 3), depth


def fit(model: FitModel, features: Array, start: Array, iterations: int = 6) -> Fits:
    """Fit K hypotheses.

    Args:
        model: array, camera and weights.
        features: (K, n, 2) normalised, NaN where a LED is not seen.
        start: (K, 5) initial states.
        iterations: Gauss–Newton steps; it ends earlier when a step is below 1e-4: the next would not show.
    """
    states = start.astype(np.float64, copy=True)
    seen = np.isfinite(features[:, :, 0])
    both = np.concatenate([seen, seen], axis=1)
    measured = np.concatenate([features[:, :, 0], features[:, :, 1]], axis=1)
    measured[~both] = 0.0
    weight = both / model.sigma**2
    prior = np.array([0.0, 0.0, 0.0, 1.0, 1.0]) / model.tilt_sigma_rad**2
    for _ in range(iterations):
        image, jacobian, _ = _image(model, states)
        information, gradient = _normal_equations(measured - image, jacobian, weight, prior, states)
        step = np.linalg.solve(information, gradient)[:, :, 0]
        np.minimum(np.maximum(step, -MAX_STEP, out=step), MAX_STEP, out=step)
        states += step
        if np.abs(step).max(initial=0.0) < CONVERGED:
            break
    image, jacobian, depth = _image(model, states)
    error = measured - image
    information, _ = _normal_equations(error, jacobian, weight, prior, states)
    squared = error**2
    leds = depth.shape[1]
    return Fits(
        states=states,
        covariance=np.asarray(np.linalg.inv(information), dtype=np.float64),
        chi2=(squared * weight).sum(axis=1) + (states**2 * prior).sum(axis=1),
        residual=np.where(seen, np.sqrt(squared[:, :leds] + squared[:, leds:]), np.nan),
        in_front=np.asarray((depth > NEAREST_M).all(axis=1)),
    )


def _image(model: FitModel, states: Array) -> tuple[Array, Array, Array]:
    """Coordinates (K, 2n), all α then all β, their Jacobian (K, 2n, 5) and the depths (K, n)."""
    t_x, t_y, t_z = model.camera_xyz_m
    points = model.points_l
    leds = len(points)
    c, s = np.cos(states[:, 2:3]), np.sin(states[:, 2:3])
    cp, sp = np.cos(states[:, 3:4]), np.sin(states[:, 3:4])
    cr, sr = np.cos(states[:, 4:5]), np.sin(states[:, 4:5])
    # eq. (featurepoint), untilted
    forward = points[:, 0] * c - points[:, 1] * s
    left = points[:, 0] * s + points[:, 1] * c
    x = (t_y - states[:, 1:2]) - left
    y = t_z - points[:, 2]
    z = (states[:, 0:1] - t_x) + forward
    # the camera's tilt: pitch, then roll
    y1, depth = y * cp + z * sp, z * cp - y * sp
    x2, y2 = x * cr + y1 * sr, y1 * cr - x * sr
    inverse = 1.0 / np.maximum(depth, NEAREST_M)
    image = np.concatenate([x2 * inverse, y2 * inverse], axis=1)
    alpha, beta = image[:, :leds], image[:, leds:]
    # derivatives by x, y, θ, pitch, roll; those of X and Z by θ are −forward and −left
    jacobian = np.empty((len(states), 2 * leds, 5))
    top, bottom = jacobian[:, :leds], jacobian[:, leds:]
    top[:, :, 0] = (sp * sr - alpha * cp) * inverse
    bottom[:, :, 0] = (sp * cr - beta * cp) * inverse
    top[:, :, 1] = -cr * inverse
    bottom[:, :, 1] = sr * inverse
    top[:, :, 2] = (left * (alpha * cp - sp * sr) - forward * cr) * inverse
    bottom[:, :, 2] = (left * (beta * cp - sp * cr) + forward * sr) * inverse
    lift = y1 * inverse
    top[:, :, 3] = alpha * lift + sr * depth * inverse
    bottom[:, :, 3] = beta * lift + cr * depth * inverse
    top[:, :, 4] = beta
    bottom[:, :, 4] = -alpha
    return image, jacobian, depth


def _normal_equations(
    error: Array, jacobian: Array, weight: Array, prior: Array, states: Array
) -> tuple[Array, Array]:
    weighted = (jacobian * weight[:, :, None]).transpose(0, 2, 1)
    information = weighted @ jacobian
    information.reshape(len(states), 25)[:, ::6] += prior
    gradient = weighted @ error[:, :, None]
    gradient[:, :, 0] -= prior * states
    return information, gradient
