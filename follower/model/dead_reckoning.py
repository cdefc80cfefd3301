"""Where the array must be since it was last seen: its last pose, carried on by the wheels, and how far it may be off.

Two identical arrays differ only in where they are. The uncertainty grows while driving
as if a disturbance of the configured size had begun with the last sight of the array; a floor covers what no model
describes. The growth is capped at 0.25 m, so that a
neighbouring array stays outside the gate; after a longer blind drive the pose stays uncertain.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.config import BaseConfig, EstimatorConfig
from common.geometry import Array, Pose2, wrap_angle
from common.messages import DockingState, Drives
from common.timing import NS_PER_S
from follower.model.motion import DISTURBANCE, POSE, STATES, advance
from follower.model.odometry import PoseIncrement, WheelOdometry

AGREES_CHI2 = 16.3  # 3 degrees of freedom: 1 in 1000 true ones is refused
_FLOOR = (0.10, 0.10, 0.05)  # m, m, rad
_FARTHEST_OFF_M = 0.25  # standard deviation; a gate wider than some 1.1 m would let a neighbour's array in


class DeadReckoning:
    """Pose of {L} in {F} without sight of it; unknown until :meth:`seen`."""

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
    def leader_in_follower(self) -> Pose2 | None:
        """Expected pose of {L} in {F} at the time of the last ``drive`` or ``seen``; None if it is not known."""
        if self._time_ns is None:
            return None
        self._carry_on()
        x, y, theta = self._state[POSE].tolist()
        return Pose2(x, y, wrap_angle(theta))

    def forget(self) -> None:
        """From now on the array may be anywhere."""
        self._time_ns = self._next = None

    def seen(self, leader_in_follower: Pose2, covariance: Array, time_ns: int) -> None:
        """Start again from a pose that was seen.

        Args:
            leader_in_follower: the pose of {L} in {F}.
            covariance: (3, 3) of its x [m], y [m], θ [rad].
            time_ns: when it held; :meth:`drive` goes on from there.
        """
        pose = leader_in_follower
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

    def agrees(self, states: Array, covariances: Array) -> NDArray[np.bool_]:
        """Which fits can be of that array.

        Args:
            states: (k, ≥ 3) fits, each beginning with the pose x [m], y [m], θ [rad] of {L} in {F}.
            covariances: (k, ≥ 3, ≥ 3) theirs.

        Returns:
            (k,); true for all if no array was ever seen.
        """
        if self._time_ns is None:
            return np.ones(len(states), dtype=np.bool_)
        self._carry_on()
        step = states[:, :3] - self._state[POSE]
        step[:, 2] = np.arctan2(np.sin(step[:, 2]), np.cos(step[:, 2]))
        grown = self._covariance[POSE, POSE]
        try:
            widest = float(np.linalg.eigvalsh(grown[:2, :2])[-1])
            spread = covariances[:, :3, :3] + grown * min(1.0, _FARTHEST_OFF_M**2 / max(widest, 1e-12)) + self._floor
            chi2 = (step * np.linalg.solve(spread, step[:, :, None])[:, :, 0]).sum(axis=1)
        except np.linalg.LinAlgError:  # a covariance that is none
            return np.zeros(len(states), dtype=np.bool_)
        agreed: NDArray[np.bool_] = chi2 <= AGREES_CHI2
        return agreed


class WheelReckoning:
    """Dead reckoning by what the bus carries: the drives' measured angles, docking states.

    A state counts as one of the last measurement of the wheels: what the robot drove in between is within the floor.
    """

    def __init__(self, base: BaseConfig, config: EstimatorConfig) -> None:
        self._odometry = WheelOdometry(base)
        self._reckoning = DeadReckoning(config)
        self._measured_ns: int | None = None

    @property
    def leader_in_follower(self) -> Pose2 | None:
        """Pose of {L} in {F} now; None before the first sight, and again after a jump of the wheels' encoders."""
        return self._reckoning.leader_in_follower

    def drive(self, drives: Drives) -> None:
        """Carry on to a measurement of the wheels."""
        moved = self._odometry.advance(drives.measured_ns, drives.wheel_angle_rad)
        if moved == "repeated":
            return
        self._measured_ns = drives.measured_ns
        if moved == "jump":
            self._reckoning.forget()
        elif isinstance(moved, PoseIncrement):
            self._reckoning.drive(drives.measured_ns, moved.twist)

    def seen(self, state: DockingState) -> None:
        """Start again from a valid state."""
        time_ns = state.capture_ns if self._measured_ns is None else self._measured_ns
        pose = Pose2(state.x_m, state.y_m, state.theta_rad)
        self._reckoning.seen(pose, np.array(state.covariance).reshape(3, 3), time_ns)

    def agrees(self, state: DockingState) -> bool:
        """Whether a state can be of the array that was seen before; also if none was."""
        pose = np.array([[state.x_m, state.y_m, state.theta_rad]])
        return bool(self._reckoning.agrees(pose, np.array(state.covariance).reshape(1, 3, 3))[0])
