"""Assignments of spots to LEDs that are worth a fit: from pairs of spots at trial headings, in closed form."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from common.geometry import Array
from follower.estimator.planar_fit import FitModel

Indices = NDArray[np.intp]

NEAREST_M, FARTHEST_M = 0.5, 14.0
MAX_PITCH = 0.05
MASS_RATIO = 5.0
_HEADINGS_RAD = np.radians(np.linspace(-64.0, 64.0, 17))
_MAX_ROLL = 0.05
_TRIALS = 3000
_FITTED = 24
_WIDEST = 0.9


class Trials:
    """Proposes assignments; holds what depends on the array only."""

    def __init__(self, model: FitModel) -> None:
        points, (t_x, t_y, t_z) = model.points_l, model.camera_xyz_m
        c, s = np.cos(_HEADINGS_RAD)[:, None], np.sin(_HEADINGS_RAD)[:, None]
        # camera coordinates of the LEDs per trial heading, up to the unknown x and y of the array
        self._right = t_y - points[:, 0] * s - points[:, 1] * c
        self._depth = points[:, 0] * c - points[:, 1] * s - t_x
        self._height = t_z - points[:, 2]
        self._bases = _base_pairs(points)

    def of(self, features: Array, mass: Array) -> tuple[Indices, Array]:
        """Distinct assignments (K, n) with their starts (K, 5), most LEDs found and nearest first.

        Args:
            features: (N, 2) normalised coordinates of the spots.
            mass: (N,) their brightness; LEDs of one array are of a like brightness.
        """
        found: dict[tuple[int, ...], tuple[int, float, Array]] = {}
        for a, b in self._bases:
            for assignment, error, start in self._gathered(features, mass, a, b):
                absent = assignment.count(-1)
                known = found.get(assignment)
                if known is None or error < known[1]:
                    found[assignment] = (absent, error, start)
        ranked = sorted(found.items(), key=lambda item: item[1][:2])[:_FITTED]
        assignments = np.array([key for key, _ in ranked], dtype=np.intp).reshape(len(ranked), len(self._height))
        return assignments, np.array([value[2] for _, value in ranked]).reshape(len(ranked), 5)

    def _gathered(self, features: Array, mass: Array, a: int, b: int) -> list[tuple[tuple[int, ...], float, Array]]:
        first, second, heading, offset, pitch = self._pair_poses(features, mass, a, b)
        right = self._right[heading] + offset[:, 0:1]
        depth = np.maximum(self._depth[heading] + offset[:, 1:2], 1e-3)
        alpha = right / depth
        beta = self._height / depth + pitch[:, None]
        distance = np.hypot(
            features[None, None, :, 0] - alpha[:, :, None], features[None, None, :, 1] - beta[:, :, None]
        )
        nearest = distance.argmin(axis=2)
        error = np.take_along_axis(distance, nearest[:, :, None], axis=2)[:, :, 0]
        # a trial heading may be off by half a step: the nearer the array, the more that shifts its image
        gate = 0.006 + 0.04 / depth
        spot = np.where(error <= gate, nearest, -1)
        spot[:, a], spot[:, b] = first, second
        error[:, a] = error[:, b] = 0.0
        absent = (spot < 0).sum(axis=1)
        score = np.where(spot < 0, 0.0, error / gate).sum(axis=1)
        rows = []
        for k in np.flatnonzero(absent <= 1):
            chosen = tuple(int(i) for i in spot[k])
            if len({i for i in chosen if i >= 0}) + int(absent[k]) == len(chosen):
                start = np.array([offset[k, 1], -offset[k, 0], _HEADINGS_RAD[heading[k]], pitch[k], 0.0])
                rows.append((chosen, float(score[k]), start))
        return rows

    def _pair_poses(
        self, features: Array, mass: Array, a: int, b: int
    ) -> tuple[Indices, Indices, Indices, Array, Array]:
        """Pairs of spots as LEDs a and b at a heading: spots, heading, (X, Z) offset of the array, pitch."""
        count = len(features)
        first, second = np.divmod(np.arange(count * count), count)
        bright, dim = np.maximum(mass[first], mass[second]), np.minimum(mass[first], mass[second])
        apart = np.abs(features[first, 0] - features[second, 0])
        alike = (first != second) & (bright <= MASS_RATIO * dim) & (apart <= _WIDEST)
        first, second = first[alike], second[alike]
        alpha_a, alpha_b = features[first, 0:1], features[second, 0:1]
        # X_a + X = α_a (Z_a + Z) and the same for b, solved for the array's offset (X, Z)
        lead_a = alpha_a * self._depth[:, a] - self._right[:, a]
        lead_b = alpha_b * self._depth[:, b] - self._right[:, b]
        with np.errstate(divide="ignore", invalid="ignore"):
            z = (lead_a - lead_b) / (alpha_b - alpha_a)
            depth_a, depth_b = z + self._depth[:, a], z + self._depth[:, b]
            pitch_a = features[first, 1:2] - self._height[a] / depth_a
            pitch_b = features[second, 1:2] - self._height[b] / depth_b
            pitch = 0.5 * (pitch_a + pitch_b)
            loose = 0.05 * np.abs(features[first, 1:2])
            mismatch = np.abs(pitch_a - pitch_b) - _MAX_ROLL * np.abs(alpha_a - alpha_b)
            fine = (depth_a > NEAREST_M) & (depth_b > NEAREST_M) & (z < FARTHEST_M)
            fine &= (np.abs(pitch) < MAX_PITCH + loose) & (mismatch < 0.008 + loose)
        pair, heading = np.nonzero(fine)
        if len(pair) > _TRIALS:
            keep = np.argpartition(np.abs(pitch[pair, heading]), _TRIALS)[:_TRIALS]
            pair, heading = pair[keep], heading[keep]
        offset_z = z[pair, heading]
        offset_x = alpha_a[pair, 0] * offset_z + lead_a[pair, heading]
        return first[pair], second[pair], heading, np.stack([offset_x, offset_z], axis=1), pitch[pair, heading]


def _base_pairs(points: Array) -> list[tuple[int, int]]:
    """Two disjoint pairs of LEDs, widest first, so that one missing LED leaves one pair whole."""
    widest = sorted(combinations(range(len(points)), 2), key=lambda p: -abs(points[p[0], 1] - points[p[1], 1]))
    pairs = [(i, widest_j) for i, widest_j in widest]
    first = pairs[0]
    second = next(pair for pair in pairs if not set(pair) & set(first))
    return [first, second]
