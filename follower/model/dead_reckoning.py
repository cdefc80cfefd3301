"""Where the array must be since it was last seen: its last fit, carried on by the wheels, with what that may be off.

Two like arrays cannot be told apart by their looks, only by where they are. The uncertainty grows while driving as if
a disturbance of the configured size had begun with the last sight of the array; a floor holds what no model knows.
It ends where a neighbouring array would pass: who drove on blindly for longer stays unsure.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.config import EstimatorConfig
from common.geometry import Array, Pose2, wrap_angle
from common.timing import NS_PER_S
from follower.model.motion import DISTURBANCE, POSE, STATES, advance

AGREES_CHI2 = 16.3  # 3 degrees of freedom: 1 in 1000 true ones is refused
_FLOOR = (0.10, 0.10, 0.05)  # m, m, rad
_FARTHEST_OFF_M = 0.25  # standard deviation; a gate wider than some 1.1 m would let a neighbour's array in


class DeadReckoning:
    """Pose of {L} in {F} without sight of it; knows nothing until :meth:`seen`."""

    def __init__(self, config: EstimatorConfig) -> None:
        self._disturbance = np.diag(np.square(config.disturbance.onset_sigma))
        self._floor = np.diag(np.square(_FLOOR))
        self._time_ns: int | None = None
        self._state = np.zeros(STATES)
        self._covariance = np.zeros((STATES, STATES))
        self._next: tuple[int, tuple[float, float]] | None = None

    @property
    def known(self) -> bool:
        """Whether the array has been seen."""
        return self._time_ns is not None

    @property
    def pose(self) -> Pose2:
        """Expected pose of {L} in {F} at the time of the last ``drive`` or ``seen``."""
        self._carry_on()
        x, y, theta = self._state[POSE].tolist()
        return Pose2(x, y, wrap_angle(theta))

    def forget(self) -> None:
        """From now on the array may be anywhere."""
        self._time_ns = self._next = None

    def seen(self, pose: Pose2, covariance: Array, time_ns: int) -> None:
        """Begin anew from a fit and its (3, 3) covariance of x [m], y [m], θ [rad]."""
        self._time_ns, self._next = time_ns, None
        self._state = np.array([pose.x_m, pose.y_m, pose.theta_rad, 0.0, 0.0, 0.0, 0.0])
        self._covariance = np.zeros((STATES, STATES))
        self._covariance[POSE, POSE] = covariance
        self._covariance[DISTURBANCE, DISTURBANCE] = self._disturbance

    def drive(self, time_ns: int, twist: tuple[float, float]) -> None:
        """Carry on to ``time_ns`` with the measured (v [m/s], ω [rad/s]); an earlier time changes nothing."""
        if self._time_ns is None or time_ns <= (self._next[0] if self._next else self._time_ns):
            return
        self._carry_on()
        self._next = (time_ns, twist)

    def _carry_on(self) -> None:
        """Drive what is still to be driven; put off until it is asked for, as the next sight makes it needless."""
        if self._time_ns is None or self._next is None:
            return
        (time_ns, twist), self._next = self._next, None
        self._state, transition = advance(self._state, *twist, (time_ns - self._time_ns) / NS_PER_S)
        self._covariance = transition @ self._covariance @ transition.T
        self._time_ns = time_ns

    def agrees(self, states: Array, covariance: Array) -> NDArray[np.bool_]:
        """(K,) whether fits (K, ≥ 3) with covariance (K, ≥ 3, ≥ 3) can be that array; all, if none was ever seen."""
        if self._time_ns is None:
            return np.ones(len(states), dtype=np.bool_)
        self._carry_on()
        step = states[:, :3] - self._state[POSE]
        step[:, 2] = np.arctan2(np.sin(step[:, 2]), np.cos(step[:, 2]))
        grown = self._covariance[POSE, POSE]
        widest = float(np.linalg.eigvalsh(grown[:2, :2])[-1])
        spread = covariance[:, :3, :3] + grown * min(1.0, _FARTHEST_OFF_M**2 / max(widest, 1e-12)) + self._floor
        chi2 = (step * np.linalg.solve(spread, step[:, :, None])[:, :, 0]).sum(axis=1)
        agreed: NDArray[np.bool_] = chi2 <= AGREES_CHI2
        return agreed
