"""Pose of the array by Gauss–Newton on its features: x, y, θ on the floor, camera pitch and roll under a prior.

Model: :mod:`follower.model.array`, with the camera's own tilt away from its mounting. A planar
fit without the tilt takes 0.3° of pitch for tens of centimetres of distance; with it as a state under a prior
the same pitch costs a few. Many hypotheses are fitted at once, as identification needs it;
:mod:`follower.estimator.single_fit` does the same for one, several times faster.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from common.geometry import Array
from follower.model.array import NEAREST_M, LedArray

CONVERGED = 1e-4
MAX_STEP = np.array([1.5, 1.5, 0.5, 0.1, 0.1])


@dataclass(frozen=True)
class FitModel:
    """LEDs in {L}, camera in {F}, and the standard deviations of features and tilt.

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

    @cached_property
    def array(self) -> LedArray:
        """The projection of these LEDs."""
        return LedArray(self.points_l, self.camera_xyz_m)


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
    """Features of many states, one row per LED.

    Args:
        model: array and camera.
        states: (K, 5) x, y [m], θ, pitch, roll [rad].

    Returns:
        Features (K, n, 2), Jacobian (K, n, 2, 5), depths (K, n) [m].
    """
    image, jacobian, depth = model.array.project(states)
    return image.swapaxes(1, 2), jacobian.swapaxes(1, 2), depth


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
        image, jacobian, _ = _stacked(model, states)
        information, gradient = _normal_equations(measured - image, jacobian, weight, prior, states)
        step = np.linalg.solve(information, gradient)[:, :, 0]
        np.minimum(np.maximum(step, -MAX_STEP, out=step), MAX_STEP, out=step)
        states += step
        if np.abs(step).max(initial=0.0) < CONVERGED:
            break
    image, jacobian, depth = _stacked(model, states)
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


def _stacked(model: FitModel, states: Array) -> tuple[Array, Array, Array]:
    """Coordinates (K, 2n), all α then all β, their Jacobian (K, 2n, 5) and the depths (K, n)."""
    image, jacobian, depth = model.array.project(states)
    rows = 2 * depth.shape[1]
    return image.reshape(-1, rows), jacobian.reshape(-1, rows, 5), depth


def _normal_equations(
    error: Array, jacobian: Array, weight: Array, prior: Array, states: Array
) -> tuple[Array, Array]:
    weighted = (jacobian * weight[:, :, None]).transpose(0, 2, 1)
    information = weighted @ jacobian
    information.reshape(len(states), 25)[:, ::6] += prior
    gradient = weighted @ error[:, :, None]
    gradient[:, :, 0] -= prior * states
    return information, gradient
