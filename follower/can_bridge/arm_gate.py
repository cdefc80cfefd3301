"""The arms' part of the gate: what of the arms' set-points reaches joints, grippers and lift.

docs/safety.md, layer 2. Pure, as :mod:`follower.can_bridge.gate`. A set-point is followed for 100 ms; torques are
capped by constants and by the limit of each drive; a joint that moves too fast is not pushed further, and one whose
angle jumps has an encoder that cannot be trusted (S22). Without a genuine set-point the decision names the rule, and
the caller holds the arms: they never release what they hold.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from common.ceilings import HARD_GRIP_TORQUE_N_M, HARD_JOINT_TORQUE_N_M, HARD_LIFT_M
from common.config import DriveConfig, FollowerCanConfig
from common.messages import ArmSetpoint
from common.timing import NS_PER_MS, NS_PER_S

MAX_JOINT_SPEED_RAD_S: Final = 1.5
MAX_GRIP_SPEED_RAD_S: Final = 4.0
MAX_JOINT_STEP_RAD: Final = 0.2
STEP_MAX_AGE_MS: Final = 50
"""An angle that changes by more than MAX_JOINT_STEP_RAD within this time jumped: no collision is that fast."""
SETPOINT_MAX_AGE_MS: Final = 100


@dataclass(frozen=True, kw_only=True)
class StampedArms:
    """A set-point with its envelope's stamp and boot."""

    setpoint: ArmSetpoint
    stamp_ns: int
    boot_id: str


@dataclass(frozen=True, kw_only=True)
class ArmMeasurement:
    """Angles of six joints and two grippers [rad], measured at ``measured_ns``."""

    measured_ns: int
    angles_rad: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class ArmDecision:
    """Torques [N·m] and height of the lift [m] for the drives; without a height the lift stays.

    ``rule`` names why nothing is passed on, or is ""; ``clipped`` names what was reduced.
    """

    joint_torque_n_m: tuple[float, ...] = (0.0,) * 6
    grip_torque_n_m: tuple[float, float] = (0.0, 0.0)
    lift_m: float | None = None
    rule: str = ""
    clipped: tuple[str, ...] = ()


class ArmGate:
    """Keeps the last measurement, from which the speeds are derived."""

    def __init__(self, config: FollowerCanConfig, boot_id: str) -> None:
        caps = [_cap(drive, HARD_JOINT_TORQUE_N_M) for drive in config.joints]
        self._torque_caps = (*caps, *(_cap(drive, HARD_GRIP_TORQUE_N_M) for drive in config.grippers))
        self._speed_caps = (MAX_JOINT_SPEED_RAD_S,) * len(config.joints) + (MAX_GRIP_SPEED_RAD_S,) * 2
        self._lift_max_m = min(config.lift_max_m, HARD_LIFT_M)
        self._boot_id = boot_id
        self._before: ArmMeasurement | None = None
        self._speeds = (0.0,) * len(self._torque_caps)
        self._joints = len(config.joints)
        self._jumped = False

    def step(self, now_ns: int, newest: StampedArms | None, epoch: int, measured: ArmMeasurement) -> ArmDecision:
        """Decide what goes to the arms in this frame.

        Args:
            now_ns: CLOCK_MONOTONIC of this boot.
            newest: the newest set-point that arrived; None before the first.
            epoch: the armed epoch.
            measured: the newest angles.

        Returns:
            What the drives get, or why they get nothing.
        """
        self._speeds = self._measure(measured)
        rule = self._refusal(now_ns, newest, epoch)
        if rule or newest is None:
            return ArmDecision(rule=rule)
        wanted = (*newest.setpoint.joint_torque_n_m, *newest.setpoint.grip_torque_n_m)
        clipped: list[str] = []
        capped = tuple(max(-cap, min(cap, torque)) for torque, cap in zip(wanted, self._torque_caps, strict=True))
        if capped != wanted:
            clipped.append("arm_torque")
        slowed = self._slow(capped)
        if slowed != capped:
            clipped.append("arm_speed")
        lift_m = max(0.0, min(self._lift_max_m, newest.setpoint.lift_m))
        return ArmDecision(
            joint_torque_n_m=slowed[:6],
            grip_torque_n_m=(slowed[6], slowed[7]),
            lift_m=lift_m,
            clipped=tuple(clipped),
        )

    def _refusal(self, now_ns: int, newest: StampedArms | None, epoch: int) -> str:
        if newest is None or newest.boot_id != self._boot_id:
            return "arm_setpoint_age"
        if not 0 <= now_ns - newest.stamp_ns <= SETPOINT_MAX_AGE_MS * NS_PER_MS:
            return "arm_setpoint_age"
        setpoint = newest.setpoint
        if not all(map(math.isfinite, (*setpoint.joint_torque_n_m, *setpoint.grip_torque_n_m, setpoint.lift_m))):
            return "arm_not_finite"
        if not all(map(math.isfinite, self._speeds)):
            return "arm_not_measured"
        if self._jumped:
            return "arm_jump"
        return "arm_epoch" if setpoint.epoch != epoch else ""

    def _measure(self, measured: ArmMeasurement) -> tuple[float, ...]:
        """Speeds between the last two measurements, and whether a joint jumped; kept while there is no new one."""
        before = self._before
        if before is None or measured.measured_ns <= before.measured_ns:
            self._before = before or measured
            return self._speeds
        elapsed_ns = measured.measured_ns - before.measured_ns
        self._before = measured
        steps = [b - a for a, b in zip(before.angles_rad, measured.angles_rad, strict=True)]
        farthest = max(map(abs, steps[: self._joints]))
        self._jumped = farthest > MAX_JOINT_STEP_RAD and elapsed_ns <= STEP_MAX_AGE_MS * NS_PER_MS
        return tuple(step * NS_PER_S / elapsed_ns for step in steps)

    def _slow(self, torques: Sequence[float]) -> tuple[float, ...]:
        """No torque in the direction in which a joint is too fast already; braking is free."""
        return tuple(
            0.0 if abs(speed) > limit and torque * speed > 0.0 else torque
            for torque, speed, limit in zip(torques, self._speeds, self._speed_caps, strict=True)
        )


def _cap(drive: DriveConfig, hard_n_m: float) -> float:
    """The drive's limit at the output shaft, at most the constant."""
    return min(hard_n_m, drive.rated_torque_n_m * drive.gear_ratio * drive.max_torque_permille / 1000.0)
