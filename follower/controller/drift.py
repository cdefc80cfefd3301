"""How the default controller treats lateral and yaw drift.

By what law a drift fades on the way to standstill is not known: rubber yields, wheels scrub. Nothing here depends on
one: a plan takes the drift as it is at the present speed, and a drifting robot that has arrived stands.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from common.geometry import Array
from follower.model.motion import FADING_BELOW_M_S, MotionDisturbance, share_of_drift

SLOW_M_S = 0.01
STOP_SHARE, LEAVE_SHARE = 0.5, 1.0  # of the arrival's tolerance: where a drifting robot stops, and starts again


def as_planned(disturbance: MotionDisturbance, v_m_s: float) -> MotionDisturbance:
    """What a plan expects of a disturbance that is observed at a speed.

    Yaw: the current value. Sideways: constant for each metre driven, if the speed is one at which drifts fade;
    tapering to zero below ``SLOW_M_S``, where noise would be amplified.
    """
    speed = abs(v_m_s)
    fading = min(1.0, max(speed, SLOW_M_S) / FADING_BELOW_M_S)
    sideways = disturbance.sideways_m_s * min(1.0, speed / SLOW_M_S) / fading
    return replace(
        disturbance,
        yaw_rad_s=share_of_drift(v_m_s) * disturbance.yaw_rad_s,
        sideways_m_s=float(np.clip(sideways, -FADING_BELOW_M_S, FADING_BELOW_M_S)),
    )


class DriftStop:
    """Whether a drifting robot should stand at the goal: further moves would add error.

    One that does not drift creeps on to the goal itself.

    Args:
        tolerance: (2n+1,) of the arrival, for features and θ.
    """

    def __init__(self, tolerance: Array) -> None:
        self._tolerance = tolerance
        self._standing = False

    def reset(self) -> None:
        """Start again: the robot does not stand."""
        self._standing = False

    def update(self, error: Array) -> bool:
        """Whether the robot stands from now on.

        Args:
            error: (2n+1,) of features and θ against the goal.
        """
        share = LEAVE_SHARE if self._standing else STOP_SHARE
        self._standing = bool(np.all(np.abs(error) < share * self._tolerance))
        return self._standing
