"""Tells the onset of a disturbance from noise: running means of the innovation, at two speeds.

Noise leaves the innovation white; a disturbance shifts its mean. Along α (all points move sideways together) that
means yaw or drift, along β (all grow) a wrong forward speed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from common.geometry import Array

MEMORY = (0.08, 0.02)  # share of the newest innovation in the running mean: about 0.2 s and 0.8 s at 60 Hz
THRESHOLD = (16.0, 14.0)  # squared, in standard deviations of the running mean: a false alarm in some 200 dockings
DELAY_S = (0.25, 0.60)  # how long a disturbance has acted, about, when each mean tells it


@dataclass(frozen=True)
class Onset:
    """The motion is not what it was taken for: a disturbance has begun, changed or ended.

    Attributes:
        acting_s: for about how long already.
        sideways, forward: mean innovation of α, of β, in its standard deviations; zero where it tells nothing.
    """

    acting_s: float
    sideways: float
    forward: float


class OnsetDetector:
    """Two running means for each of α and β."""

    def __init__(self) -> None:
        self._means = np.zeros((2, 2))
        self._memory = np.array(MEMORY)

    def reset(self) -> None:
        """Forget: after a detection, and at the start."""
        self._means[:] = 0.0

    def update(self, innovation: Array, spread: Array) -> Onset | None:
        """Take the innovation (n, 2) of the points used and its covariance (2n, 2n), rows α_0 β_0 α_1 …"""
        normalised = [innovation[:, i].mean() / np.sqrt(spread[i::2, i::2].mean()) for i in (0, 1)]
        self._means += self._memory[:, None] * (np.array(normalised) - self._means)
        squared = self._means**2 * ((2.0 - self._memory) / self._memory)[:, None]
        hits = squared > np.array(THRESHOLD)[:, None]
        if not hits.any():
            return None
        sideways, forward = np.where(hits.any(axis=0), self._means[0], 0.0)
        self.reset()
        return Onset(DELAY_S[0] if hits[0].any() else DELAY_S[1], float(sideways), float(forward))
