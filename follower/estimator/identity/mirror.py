"""Whether a mirror image of the array explains three LEDs as well as the array itself does.

Four LEDs distinguish left from right, as the array is asymmetric. Of three, the two lower ones with the upper one
nearest to their middle look from near by almost like their own mirror image, turned to the other side of the line of
sight.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations

import numpy as np

from common.geometry import Array
from follower.estimator.planar_fit import FitModel, fit


class MirrorCheck:
    """Everything that depends on the array alone is computed once."""

    def __init__(self, model: FitModel) -> None:
        self._model = replace(model, points_l=model.points_l * [1.0, -1.0, 1.0])

    def chi2(self, features: Array, state: Array) -> float:
        """Least χ² of a mirror image in a pane of glass.

        Args:
            features: (k, 2) normalised, of the LEDs that are seen.
            state: (5,) fitted to them; a mirror image stands there as well, turned to the other side.
        """
        leds = len(self._model.points_l)
        orders = np.array(list(permutations(range(leds), len(features))))
        tried = np.full((len(orders), leds, 2), np.nan)
        tried[np.arange(len(orders))[:, None], orders] = features
        turned = state.copy()
        turned[2] = 2.0 * np.arctan2(state[1], state[0]) - state[2]
        fits = fit(self._model, tried, np.repeat(turned[None], len(orders), axis=0))
        return float(np.where(fits.in_front, fits.chi2, np.inf).min())
