"""Shadow: everything runs, nothing moves. The drives are never enabled; the gate judges as if they obeyed.

Pure. What is published as measured stays what was measured; only the bridge's own judgement sees drives that are in
operation and wheels that follow what would have been sent, with the drives' ramp.
"""

from __future__ import annotations

from dataclasses import replace

from common.config import BaseConfig, FollowerCanConfig
from common.timing import NS_PER_S
from follower.can_bridge.measurement import DriveSetpoint, Measurement


class Shadow:
    """Stands in for drives that obey."""

    def __init__(self, config: FollowerCanConfig, base: BaseConfig) -> None:
        self._ramp_rad_s2 = 2.0 * config.wheel_ramp_m_s2 / base.wheel_radius_m
        self._told = (0.0, 0.0)
        self._rolling = (0.0, 0.0)
        self._now_ns: int | None = None

    def pretend(self, measured: Measurement) -> Measurement:
        """The measurement as it would be, had the drives been enabled and obeyed :meth:`withhold`'s set-points."""
        elapsed_ns = measured.now_ns - self._now_ns if self._now_ns is not None else 0
        self._now_ns = measured.now_ns
        step = self._ramp_rad_s2 * max(elapsed_ns, 0) / NS_PER_S
        left, right = (
            now + min(step, max(-step, told - now)) for now, told in zip(self._rolling, self._told, strict=True)
        )
        self._rolling = left, right
        return replace(measured, wheel_speed_rad_s=self._rolling, wheels_enabled=True, arms_enabled=True)

    def withhold(self, setpoint: DriveSetpoint) -> DriveSetpoint:
        """Remember what would have been sent; what is sent instead: nothing."""
        self._told = setpoint.left_rad_s, setpoint.right_rad_s
        return DriveSetpoint()
