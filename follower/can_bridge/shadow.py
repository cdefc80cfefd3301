"""Shadow: everything runs, nothing moves. The drives are never enabled; the gate decides as if they followed.

Pure. The published measurement stays the real one; only the bridge's own decisions are based on drives that are in
operation and wheels whose speeds and angles follow the withheld set-points with the drives' ramp.
"""

from __future__ import annotations

from dataclasses import replace

from common.config import BaseConfig, FollowerCanConfig
from common.timing import NS_PER_S
from follower.can_bridge.measurement import BusMeasurement, DriveSetpoint


class Shadow:
    """Stands in for drives that follow their set-points."""

    def __init__(self, config: FollowerCanConfig, base: BaseConfig) -> None:
        ramp_rad_s2 = 2.0 * config.wheel_ramp_m_s2 / base.wheel_radius_m
        self._left, self._right = _Wheel(ramp_rad_s2), _Wheel(ramp_rad_s2)
        self._now_ns: int | None = None

    def pretend(self, measured: BusMeasurement) -> BusMeasurement:
        """The measurement as it would be, had the drives followed :meth:`withhold`'s set-points."""
        elapsed_ns = measured.now_ns - self._now_ns if self._now_ns is not None else 0
        self._now_ns = measured.now_ns
        for wheel in (self._left, self._right):
            wheel.roll(max(elapsed_ns, 0) / NS_PER_S)
        return replace(
            measured,
            wheel_speed_rad_s=(self._left.speed_rad_s, self._right.speed_rad_s),
            wheel_angle_rad=(self._left.angle_rad, self._right.angle_rad),
            wheels_enabled=True,
            arms_enabled=True,
        )

    def withhold(self, setpoint: DriveSetpoint) -> DriveSetpoint:
        """Keep what would have been sent; return what is sent instead: zero."""
        self._left.commanded_rad_s, self._right.commanded_rad_s = setpoint.left_rad_s, setpoint.right_rad_s
        return DriveSetpoint()


class _Wheel:
    """One wheel that follows its set-point with the drive's ramp."""

    def __init__(self, ramp_rad_s2: float) -> None:
        self._ramp_rad_s2 = ramp_rad_s2
        self.commanded_rad_s = 0.0
        self.speed_rad_s = 0.0
        self.angle_rad = 0.0

    def roll(self, elapsed_s: float) -> None:
        step = self._ramp_rad_s2 * elapsed_s
        before = self.speed_rad_s
        self.speed_rad_s = before + min(step, max(-step, self.commanded_rad_s - before))
        self.angle_rad += 0.5 * (before + self.speed_rad_s) * elapsed_s
