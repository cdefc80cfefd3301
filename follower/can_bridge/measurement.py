"""Set-points for the drives and what comes back from the bus, in SI units at the output shafts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from common.canopen.cia402 import DriveState
from common.causes import BAD_FRAMES, BUS_LOST, NODE_SILENT

STATUS_MAX_AGE_MS: Final = 50
"""Age from which a drive or the I/O module counts as silent, and its last report as unknown (docs/safety.md S21)."""


@dataclass(frozen=True, kw_only=True)
class DriveSetpoint:
    """Set-points of all drives: wheels [rad/s], joints and grippers [N·m], lift [m]; without a height the lift stays.

    The default is zero everywhere.
    """

    left_rad_s: float = 0.0
    right_rad_s: float = 0.0
    joint_torque_n_m: tuple[float, ...] = (0.0,) * 6
    grip_torque_n_m: tuple[float, float] = (0.0, 0.0)
    lift_m: float | None = None

    def per_axis(self) -> Iterator[float | None]:
        """In the order wheels, joints, grippers, lift."""
        yield self.left_rad_s
        yield self.right_rad_s
        yield from self.joint_torque_n_m
        yield from self.grip_torque_n_m
        yield self.lift_m


@dataclass(frozen=True, kw_only=True)
class BusMeasurement:
    """What the bus reported at one exchange.

    ``measured_ns`` is the SYNC that latched the older of the two wheels' answers, −1 before the first. Stop inputs
    count as STOP while the I/O module is silent. ``faults`` is empty when all is well. Two conditions may end by
    themselves: ``silent`` names drives that do not answer, ``bad_frames`` reports frames that cannot be genuine.
    ``stalled`` gives for how long the bridge itself stalled, so that the drives' watchdogs stopped them; it is kept
    until power off is requested.
    """

    now_ns: int
    measured_ns: int
    wheel_speed_rad_s: tuple[float, float]
    wheel_angle_rad: tuple[float, float]
    joint_torque_n_m: tuple[float, ...]
    joint_angle_rad: tuple[float, ...]
    grip_torque_n_m: tuple[float, float]
    grip_angle_rad: tuple[float, float]
    lift_m: float
    inputs_fresh: bool
    estop_clear: bool
    protective_clear: bool
    battery_v: float | None
    states: tuple[DriveState, ...]
    wheels_enabled: bool
    arms_enabled: bool
    bus_ok: bool
    faults: tuple[str, ...]
    malformed: int
    unknown: int
    stalled: str = ""
    silent: tuple[str, ...] = ()
    bad_frames: str = ""
    bus_lost: str = ""

    @property
    def troubles(self) -> tuple[str, ...]:
        """Everything that is wrong, in one list."""
        return (
            *self.faults,
            *self.silent,
            *(text for text in (self.stalled, self.bad_frames, self.bus_lost) if text),
        )

    @property
    def passing(self) -> str:
        """Cause to stop for by a condition that may end by itself; empty if there is none."""
        if self.bus_lost:
            return f"{BUS_LOST}: {self.bus_lost}"
        if self.silent:
            return f"{NODE_SILENT}: {self.silent[0]}"
        return f"{BAD_FRAMES}: {self.bad_frames}" if self.bad_frames else ""
