"""Whether spots are as bright as LEDs at the fitted pose: beam over squared distance, in an absolute band.

A LED near by clips the sensor, so its peak is no measure; the sum of its grey levels still grows with its strength.
Strength here is the grey level that its centre would reach without clipping. The image of a LED is taken for a
diamond, exp(−(|x| + |y|)/w), so that the area brighter than g is 2 w² ln²(S/g), and the sum its integral over g.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from common.config import CameraConfig, LedsConfig
from common.geometry import Array
from follower.estimator.spots import PEAK_FRACTION

Verdict = Literal["like", "dim", "unlike"]
_WHITE = 255.0
_DIMMEST_COSINE = 0.1


class LedBrightness:
    """Compares with the configured ``leds.brightness``; built only where that is configured."""

    def __init__(self, leds: LedsConfig, camera: CameraConfig) -> None:
        if leds.brightness is None:
            raise ValueError("leds.brightness is not configured")
        self._points, self._camera_xyz = leds.points, camera.mount
        self._factor = leds.brightness.factor
        self._at_1_m = leds.brightness.grey_per_us_at_1_m * camera.exposure_us * camera.gain * leds.current_a
        self._exponent = math.log(0.5) / math.log(math.cos(math.radians(leds.full_beam_deg / 2)))
        self._speck_px = leds.brightness.speck_px

    def expected(self, state: Array) -> Array:
        """Strength of each LED at a pose: grey levels at its centre, unclipped, (n,).

        Args:
            state: (≥ 3,) x, y [m], θ [rad] of {L} in {F}, …
        """
        c, s = math.cos(state[2]), math.sin(state[2])
        p = self._points
        in_f = np.stack([state[0] + c * p[:, 0] - s * p[:, 1], state[1] + s * p[:, 0] + c * p[:, 1], p[:, 2]], axis=1)
        away = in_f - self._camera_xyz
        square = (away**2).sum(axis=1)
        cosine = np.maximum((away[:, 0] * c + away[:, 1] * s) / np.sqrt(square), _DIMMEST_COSINE)
        strength: Array = self._at_1_m * cosine**self._exponent / square
        return strength

    def measured(self, mass: Array, threshold: int) -> Array:
        """Strength from the spots' masses, (n,), as :mod:`follower.estimator.spots` sums them above the threshold.

        Args:
            mass: (n,) grey levels.
            threshold: of the spots, grey levels.
        """
        strength = np.geomspace(1.05 * threshold, 1e7, 400)
        top = np.minimum(strength, _WHITE)
        level = np.maximum(threshold, PEAK_FRACTION * top)
        summed = 2.0 * self._speck_px**2 * (_integral(strength, top) - _integral(strength, level))
        found: Array = np.exp(np.interp(mass, summed, np.log(strength), left=0.0))
        return found

    def judge(self, state: Array, mass: Array, threshold: int, light: float = 1.0) -> Verdict:
        """Whether the spots can be the LEDs at that state.

        They can (``like``) if all are within the factor and none is further than the factor from another; they are
        ``dim`` if they are so alike, but all too dim.

        Args:
            state: (≥ 3,) x, y [m], θ [rad] of {L} in {F}, …
            mass: (n,) spot masses, NaN where not seen.
            threshold: of the spots, grey levels.
            light: the image's exposure times gain over the configured ones.
        """
        seen = np.isfinite(mass)
        ratio = np.log(self.measured(mass[seen], threshold) / (light * self.expected(state)[seen]))
        most, middle = math.log(self._factor), float(np.median(ratio))
        if float(np.ptp(ratio)) > most or middle > most:
            return "unlike"
        return "like" if middle >= -most else "dim"


def _integral(strength: Array, grey: Array) -> Array:
    """Antiderivative of ln²(S/g) by g."""
    log = np.log(strength / grey)
    value: Array = grey * (log**2 + 2.0 * log + 2.0)
    return value
