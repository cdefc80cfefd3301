"""A recorded approach: what each image showed, and how far the wheels had turned."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.geometry import Array

Stamps = NDArray[np.int64]


@dataclass(frozen=True)
class Drive:
    """One approach.

    Attributes:
        frames_ns: (k,) middle of each exposure, rising.
        features: (k, n, 2) not levelled, normalised by lens and mounting as configured; NaN where not seen.
        poses: (k, 3) estimated x [m], y [m], θ [rad] of {L} in {F}: where the fit begins.
        wheels_ns: (m,) times of the wheels' measurements, rising.
        wheel_angle_rad: (m, 2) left and right, by the configured gears.
    """

    frames_ns: Stamps
    features: Array
    poses: Array
    wheels_ns: Stamps
    wheel_angle_rad: Array
