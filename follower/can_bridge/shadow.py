"""Shadow: everything runs, nothing moves. The drives are never enabled; the gate decides as if they followed.

Pure. The published measurement stays the real one; only the bridge's own decisions are based on drives that are in
operation and wheels whose speeds follow the withheld set-points with the drives' ramp.
"""

from __future__ import annotations

from dataclasses import replace

from common.config import BaseConfig, FollowerCanConfig
from common.timing import NS_PER_S
from follower.can_bridge.measurement import BusMeasurement, DriveSetpoint


class Shadow:
    """Stands in for drives that follow their set-points."""

    def __init__(self, config: FollowerCanConfig, base: BaseConfig) -> None:
        self._ramp_rad_s2 = 2.0 * config.wheel_ramp_m_s2 / base.wheel_radius_m
        self._commanded = (0.0, 0.0)
        self._rolling_rad_s = (0.0, 0.0)
        self._now_ns: int | None = None

    def pretend(self, measured: BusMeasurement) -> BusMeasurement:
        """The measurement as it would be, had the drives followed :meth:`withhold`'s set-points."""
        elapsed_ns = measured.now_ns - self._now_ns if self._now_ns is not None else 0
        self._now_ns = measured.now_ns
        step = self._ramp_rad_s2 * max(elapsed_ns, 0) / NS_PER_S
        left, right = (
            now + min(step, max(-step, commanded - now))
            for now, commanded in zip(self._rolling_rad_s, self._commanded, strict=True)
        )
        self._rolling_rad_s = left, right
        return replace(measured, wheel_speed_rad_s=self._rolling_rad_s, wheels_enabled=True, arms_enabled=True)

    def withhold(self, setpoint: DriveSetpoint) -> DriveSetpoint:
        """Keep what would have been sent; return what is sent instead: zero."""
        self._commanded = setpoint.left_rad_s, setpoint.right_rad_s
        return DriveSetpoint()
