"""Holding the handle: constant torques out, force and contact from the joint torques in."""

from __future__ import annotations

from common.config import ArmsConfig
from common.messages import ArmSetpoint, ArmState, Drives, Mission

# the pushing force's share in an arm's three joints, shoulder first, in the holding posture
JOINT_SHARES = (1.0, 0.6, 0.2)
_CONTACT_SAMPLES = 5
_RELEASE_SHARE = 0.5
_FILTER_SHARE = 0.2
_CLOSED_RAD, _OPEN_RAD = 0.3, 1.0


class _Threshold:
    """Passed by a force that stays above for 50 ms, until it falls below half."""

    def __init__(self, force_n: float) -> None:
        self._threshold_n = force_n
        self._above = 0
        self._on = False

    def passed(self, force_n: float) -> bool:
        self._above = self._above + 1 if force_n > self._threshold_n else 0
        if self._above >= _CONTACT_SAMPLES:
            self._on = True
        elif force_n < _RELEASE_SHARE * self._threshold_n:
            self._on = False
        return self._on


class HandleHold:
    """Steps at 100 Hz with each measurement of the drives."""

    def __init__(self, config: ArmsConfig) -> None:
        self._config = config
        self._force_n = 0.0
        self._contact = _Threshold(config.contact_force_n)
        self._connected = _Threshold(config.connected_force_n)

    def feel(self, drives: Drives) -> ArmState:
        """Force along the handle from the shoulder torques, contact and rigid connection."""
        left, right = drives.joint_torque_n_m[0], drives.joint_torque_n_m[3]
        self._force_n += _FILTER_SHARE * ((left + right) / self._config.lever_m - self._force_n)
        return ArmState(
            handle_force_n=self._force_n,
            contact=self._contact.passed(self._force_n),
            connected=self._connected.passed(self._force_n),
            gripped=all(angle < _CLOSED_RAD for angle in drives.grip_angle_rad),
            released=all(angle > _OPEN_RAD for angle in drives.grip_angle_rad),
        )

    def hold(self, mission: Mission) -> ArmSetpoint:
        """Torques that push the handle along the chassis while a trolley is held; none with open grippers."""
        config = self._config
        holding = mission.grip == "closed"
        per_arm = config.pushing_force_n * config.lever_m / 2 if holding else 0.0
        grip = config.grip_torque_n_m if holding else config.release_torque_n_m
        joints = tuple(share * per_arm for _ in range(2) for share in JOINT_SHARES)
        return ArmSetpoint(mission.epoch, joints, (grip, grip), config.lift_height_m)
