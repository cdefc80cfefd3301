"""Following identified LEDs from frame to frame: prediction, gates, and a fit that no single spot can bend."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from common.frames.ring import Image
from common.geometry import Array, Pose2, interaction_matrix, move_relative, wrap_angle
from follower.estimator.lens import Lens
from follower.estimator.planar_fit import FitModel, fit
from follower.estimator.single_fit import PlanarFit, features_of, fit_one
from follower.estimator.spots import SpotRule, Spots, find_spots_near

Chosen = list[int]

_REGION_HALF_PX = 20
_COMMON_GATE_PX = 2.5
_GATE_GROWTH_PX = 0.4
_MASS_FACTOR = 2.2
_MOST_ELONGATED = 1.6
_CHI2_FULL, _CHI2_PARTIAL = 22.0, 12.0
_LEFT_OUT_MARGIN = 9.0
_INNOVATION_CHI2 = 25.0
_MASS_FILTER = 0.2
_FEWEST = 3


def predict_features(
    features: Array, height_difference_m: Array, camera_xyz_m: Array, twist: tuple[float, float], duration_s: float
) -> Array:
    """Features (n, 2) after the Follower drove a twist: eq. (17), prediction by the interaction matrix.

    Args:
        features: (n, 2) normalised, before.
        height_difference_m: (n,) Δh = Z_C − Z_P per LED.
        camera_xyz_m: ξ in {F} [m].
        twist: v [m/s], ω [rad/s].
        duration_s: for how long.
    """
    flow = interaction_matrix(features, height_difference_m, camera_xyz_m) @ np.array(twist)
    predicted: Array = features + flow * duration_s
    return predicted


def predict_state(state: Array, twist: tuple[float, float], duration_s: float) -> Array:
    """State after the twist; the camera's tilt stays.

    Args:
        state: (5,) x, y [m], θ, pitch, roll [rad].
        twist: v [m/s], ω [rad/s].
        duration_s: for how long.
    """
    moved = move_relative(Pose2(float(state[0]), float(state[1]), float(state[2])), *twist, duration_s)
    return np.array([moved.x_m, moved.y_m, moved.theta_rad, state[3], state[4]])


def nearest_within(predicted_px: Array, spots_px: Array, gate_px: float) -> Chosen:
    """Spot of each predicted LED: the nearest within the gate, each spot at most once, −1 where there is none.

    Args:
        predicted_px: (n, 2).
        spots_px: (m, 2).
        gate_px: farthest that a spot may be.
    """
    chosen = [-1] * len(predicted_px)
    if not len(spots_px):
        return chosen
    distance = _distances(predicted_px, spots_px)
    while True:
        led, spot = divmod(int(np.argmin(distance)), len(spots_px))
        if not distance[led, spot] <= gate_px:
            return chosen
        chosen[led] = spot
        distance[led, :] = np.inf
        distance[:, spot] = np.inf


def moved_together(predicted_px: Array, spots_px: Array, allowed: NDArray[np.bool_], gate_px: float) -> Chosen:
    """Spot of each predicted LED under one common shift of the whole array, −1 where there is none.

    Camera tilt moves all LEDs alike, a lamp behind them does not. Every allowed pair proposes its shift; the one
    wins under which most LEDs have an allowed spot within the gate, and among equals the closest.

    Args:
        predicted_px: (n, 2).
        spots_px: (m, 2).
        allowed: (n, m) which spot may be which LED.
        gate_px: farthest that a spot may be after the shift.
    """
    pairs: list[list[int]] = np.argwhere(allowed).tolist()
    if len(pairs) == len(predicted_px) == len({led for led, _ in pairs}) == len({spot for _, spot in pairs}):
        shifts = (spots_px[[spot for _, spot in pairs]] - predicted_px).tolist()  # argwhere goes by LED
        if all(max(along) - min(along) <= gate_px for along in zip(*shifts, strict=True)):
            return [spot for _, spot in pairs]
    best: tuple[float, Chosen] = (-1.0, [-1] * len(predicted_px))
    for led, spot in pairs:
        shift = spots_px[spot] - predicted_px[led]
        distance = np.where(allowed, _distances(predicted_px + shift, spots_px), np.inf)
        chosen = [-1] * len(predicted_px)
        cost = 0.0
        for row in np.argsort(distance.min(axis=1)):
            nearest = int(np.argmin(distance[row]))
            if distance[row, nearest] <= gate_px:
                chosen[row] = nearest
                cost += float(distance[row, nearest])
                distance[:, nearest] = np.inf
        count = len(chosen) - chosen.count(-1)
        score = count - cost / (gate_px * len(chosen) + 1e-9) - 1e-3 * math.hypot(*shift)
        if score > best[0]:
            best = (score, chosen)
    return best[1]


@dataclass(frozen=True)
class Followed:
    """The array found near its prediction.

    Attributes:
        features: (n, 2) normalised, NaN where not used.
        fitted: the pose.
        mass: (n,) spot masses to expect in the next frame.
        seen_mass: (n,) those of this frame, NaN where not used.
        spots: number of spots looked at.
    """

    features: Array
    fitted: PlanarFit
    mass: Array
    seen_mass: Array
    spots: int


class ArrayTracker:
    """Finds the array around its predicted state; keeps nothing between frames."""

    def __init__(self, model: FitModel, lens: Lens, gate_px: float) -> None:
        self._model = model
        self._lens = lens
        self._gate_px = gate_px

    def follow(
        self, image: Image, rule: SpotRule, expected: Array, mass: Array, unseen_frames: int
    ) -> Followed | int:
        """Look for the array where it is expected.

        Args:
            image: (h, w) uint8.
            rule: what counts as a spot.
            expected: (5,) predicted state x, y, θ, pitch, roll.
            mass: (n,) spot masses to expect, NaN for a LED that has not been seen yet.
            unseen_frames: frames since the array was last seen; widens the gates.

        Returns:
            The number of spots found if they are not the array.
        """
        predicted_px = self._lens.to_pixels(features_of(self._model, expected))
        growth = _GATE_GROWTH_PX * unseen_frames
        spots = find_spots_near(image, predicted_px, _REGION_HALF_PX + min(int(growth), 20), rule)
        if len(spots) < _FEWEST:
            return len(spots)
        allowed = _distances(predicted_px, spots.pixels) <= self._gate_px + growth
        allowed &= (spots.elongation <= _MOST_ELONGATED) & _mass_fits(spots, mass)
        chosen = moved_together(predicted_px, spots.pixels, allowed, _COMMON_GATE_PX + 0.5 * growth)
        if len(chosen) - chosen.count(-1) < _FEWEST:
            return len(spots)
        features = np.where(np.array(chosen)[:, None] >= 0, self._lens.to_normalised(spots.pixels)[chosen], np.nan)
        agreed = self.agreed(features, expected)
        if agreed is None or not self._expected(agreed[1], expected, unseen_frames):
            return len(spots)
        kept, fitted = agreed
        found = np.where(np.isfinite(kept[:, 0]), spots.mass[chosen], np.nan)
        return Followed(kept, fitted, _filtered(mass, found), found, len(spots))

    def agreed(self, features: Array, expected: Array) -> tuple[Array, PlanarFit] | None:
        """The features that fit one pose, at most one left out; None if they do not agree.

        Args:
            features: (n, 2) normalised, NaN where a LED is not seen.
            expected: (5,) predicted state x, y, θ, pitch, roll.
        """
        fitted = fit_one(self._model, features, expected)
        missing = int(np.isnan(features[:, 0]).sum())
        bound = _CHI2_PARTIAL if missing else _CHI2_FULL
        if fitted is not None and fitted.chi2 <= bound:
            return features, fitted
        leds = len(features)
        if leds - missing <= _FEWEST:
            return None
        reduced = np.repeat(features[None], leds, axis=0)
        reduced[range(leds), range(leds)] = np.nan
        fits = fit(self._model, reduced, np.repeat(expected[None], leds, axis=0))
        chi2 = np.where(fits.in_front & np.isfinite(features[:, 0]), fits.chi2, np.inf)
        best, second = (int(row) for row in np.argsort(chi2)[:2])
        if chi2[best] > _CHI2_PARTIAL or chi2[second] < chi2[best] + _LEFT_OUT_MARGIN:
            return None
        fitted = fit_one(self._model, reduced[best], fits.states[best])
        return None if fitted is None else (reduced[best], fitted)

    def _expected(self, fitted: PlanarFit, expected: Array, unseen_frames: int) -> bool:
        """Whether the fitted pose is where the robot can be."""
        since = 1 + unseen_frames
        slack = (0.03 + 0.01 * since, 0.03 + 0.01 * since, 0.02 + 0.005 * since)
        step = fitted.pose.as_array() - expected[:3]
        step[2] = wrap_angle(float(step[2]))
        spread = fitted.covariance.copy()
        spread.flat[::4] += [metres**2 for metres in slack]
        regular, solved = cv2.solve(spread, step[:, None], flags=cv2.DECOMP_CHOLESKY)
        return regular and float(step @ solved[:, 0]) <= _INNOVATION_CHI2


def _distances(predicted_px: Array, spots_px: Array) -> Array:
    return np.hypot(predicted_px[:, 0, None] - spots_px[None, :, 0], predicted_px[:, 1, None] - spots_px[None, :, 1])


def _mass_fits(spots: Spots, mass: Array) -> NDArray[np.bool_]:
    """(n, N): whether each spot is about as bright as each LED was; merged blobs are brighter."""
    ratio = spots.mass[None, :] / mass[:, None]
    unknown = np.isnan(mass)[:, None]
    fits: NDArray[np.bool_] = unknown | ((ratio <= _MASS_FACTOR) & (ratio >= 1.0 / _MASS_FACTOR))
    return fits


def _filtered(mass: Array, found: Array) -> Array:
    """Masses to expect next: a slow average; a LED not seen is expected to become like the others."""
    blended = np.where(np.isnan(mass), found, mass + _MASS_FILTER * (found - mass))
    unseen = np.isnan(found)
    if unseen.any():
        like_others = float(np.median(found[~unseen]))
        before = np.where(np.isnan(mass), like_others, mass)
        blended = np.where(unseen, before + _MASS_FILTER * (like_others - before), blended)
    return blended
