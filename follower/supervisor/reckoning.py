"""Where the Leader is while it is not seen: the last valid state, carried on by the wheels' odometry."""

from __future__ import annotations

import numpy as np

from common.config import BaseConfig
from common.geometry import Array, Pose2, wrap_angle
from common.messages import DockingState, Drives
from follower.model.odometry import PoseIncrement, WheelOdometry

AGREES_CHI2 = 16.3  # 3 degrees of freedom: 1 in 1000 true ones is refused
_FLOOR = np.diag(np.square([0.10, 0.10, 0.05]))  # m, m, rad: what no model knows
_SLIP_SHARE = 0.25  # of the way: slip and load that the odometry cannot see


class PoseReckoning:
    """Pose of {L} in {F}; unknown until :meth:`seen`, and again after a jump of the wheels' encoders."""

    def __init__(self, base: BaseConfig) -> None:
        self._odometry = WheelOdometry(base)
        self._pose: Pose2 | None = None
        self._covariance: Array = np.zeros((3, 3))
        self._way_m = 0.0

    @property
    def pose(self) -> Pose2 | None:
        """Pose of {L} in {F} now, None if it is not known."""
        return self._pose

    def drive(self, drives: Drives) -> None:
        """Carry on to a measurement of the wheels."""
        moved = self._odometry.advance(drives.measured_ns, drives.wheel_angle_rad)
        if moved == "jump":
            self._pose = None
        if not isinstance(moved, PoseIncrement) or self._pose is None:
            return
        back = moved.pose.inverse()
        turn = _rotation(back.theta_rad)
        self._pose = back.compose(self._pose)
        self._covariance = turn @ (self._covariance + moved.covariance) @ turn.T
        self._way_m += abs(moved.pose.x_m)

    def seen(self, state: DockingState) -> None:
        """Begin anew from a valid state."""
        self._pose = Pose2(state.x_m, state.y_m, state.theta_rad)
        self._covariance = np.array(state.covariance).reshape(3, 3)
        self._way_m = 0.0

    def agrees(self, state: DockingState) -> bool:
        """Whether a state can be of the array that was seen before; also if none was."""
        if self._pose is None:
            return True
        step = np.array([state.x_m, state.y_m, wrap_angle(state.theta_rad - self._pose.theta_rad)])
        step[:2] -= self._pose.x_m, self._pose.y_m
        slip = np.diag([(_SLIP_SHARE * self._way_m) ** 2, (_SLIP_SHARE * self._way_m) ** 2, 0.0])
        spread = self._covariance + np.array(state.covariance).reshape(3, 3) + _FLOOR + slip
        return float(step @ np.linalg.solve(spread, step)) <= AGREES_CHI2


def _rotation(theta_rad: float) -> Array:
    c, s = np.cos(theta_rad), np.sin(theta_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
