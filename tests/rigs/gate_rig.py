"""A gate with fresh inputs around it, stepped at 100 Hz."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from common.config import BaseConfig, LimitsConfig
from common.messages import Command, seal_command
from follower.can_bridge.gate import (
    ArmToken,
    Decision,
    Gate,
    StampedCommand,
    StopInputs,
    WheelStatus,
)

MS = 1_000_000
BOOT = "boot"
T0 = 10_000 * MS
RADIUS, TRACK = 0.085, 0.5
BASE = BaseConfig(wheel_radius_m=RADIUS, track_m=TRACK, latency_ms=20.0)
LIMITS = LimitsConfig(
    v_min_m_s=-0.1,
    v_max_m_s=0.5,
    w_max_rad_s=0.6,
    controller_dv_m_s=0.02,
    controller_dw_rad_s=0.08,
    gate_acceleration_m_s2=0.5,
    gate_angular_acceleration_rad_s2=2.0,
)
CLEAR = StopInputs(fresh=True, estop_clear=True, protective_clear=True)


def command(v: float = 0.3, w: float = 0.0, sequence: int = 1, stamp_ns: int = T0, epoch: int = 7) -> Command:
    return seal_command(Command(v, w, epoch, sequence, stamp_ns, stamp_ns + 500 * MS, 1, stamp_ns))


def stamped(sealed: Command, run_id: int = 5, boot_id: str = BOOT) -> StampedCommand:
    return StampedCommand(command=sealed, run_id=run_id, boot_id=boot_id)


def token(stamp_ns: int = T0, **changes: Any) -> ArmToken:
    return replace(
        ArmToken(
            armed=True, stamp_ns=stamp_ns, boot_id=BOOT, epoch=7, phase="approach", v_max_m_s=0.5, w_max_rad_s=0.6
        ),
        **changes,
    )


def wheels(v: float, now_ns: int, w: float = 0.0, drives_enabled: bool = True) -> WheelStatus:
    turn = w * TRACK / 2
    return surfaces(v - turn, v + turn, now_ns, drives_enabled)


def surfaces(left_m_s: float, right_m_s: float, now_ns: int, drives_enabled: bool = True) -> WheelStatus:
    """Measured surface speeds, at angle 0."""
    return WheelStatus(
        measured_ns=now_ns,
        left_rad_s=left_m_s / RADIUS,
        right_rad_s=right_m_s / RADIUS,
        left_rad=0.0,
        right_rad=0.0,
        drives_enabled=drives_enabled,
    )


class Bench:
    """A gate stepped at 100 Hz; wheels follow at once."""

    def __init__(self, limits: LimitsConfig = LIMITS, **standing: Any) -> None:
        self.gate = Gate(limits, BASE, BOOT)
        self.now_ns = T0
        self.v = self.w = 0.0
        self.sequence = 0
        self.standing = standing
        self._angles = (0.0, 0.0)
        self._before: WheelStatus | None = None

    def step(self, newest: StampedCommand | None = None, period_ms: float = 10.0, **given: Any) -> Decision:
        inputs = {
            "token": token(self.now_ns, **self.standing),
            "status": wheels(self.v, self.now_ns, self.w),
            "inputs": CLEAR,
            **given,
        }
        inputs["status"] = self._rolled(inputs["status"])
        decision = self.gate.step(self.now_ns, newest, **inputs)
        self.v, self.w = decision.v_m_s, decision.w_rad_s
        self.now_ns += round(period_ms * MS)
        return decision

    def _rolled(self, status: WheelStatus) -> WheelStatus:
        """At the angles that its speeds lead to, unless it has angles of its own."""
        if (status.left_rad, status.right_rad) != (0.0, 0.0) or status.measured_ns < 0:
            return status
        before, self._before = self._before, status
        if before is not None:
            elapsed_s = (status.measured_ns - before.measured_ns) * 1e-9
            speeds = (before.left_rad_s + status.left_rad_s, before.right_rad_s + status.right_rad_s)
            if all(map(math.isfinite, speeds)):
                self._angles = (
                    self._angles[0] + 0.5 * speeds[0] * elapsed_s,
                    self._angles[1] + 0.5 * speeds[1] * elapsed_s,
                )
        return replace(status, left_rad=self._angles[0], right_rad=self._angles[1])

    def order(self, v: float, w: float = 0.0, **given: Any) -> Decision:
        """One step with a new command."""
        self.sequence += 1
        return self.step(stamped(command(v, w, self.sequence, self.now_ns)), **given)

    def drive(self, v: float, w: float = 0.0, steps: int = 100) -> Decision:
        for _ in range(steps - 1):
            self.order(v, w)
        return self.order(v, w)


def replace_limits(**changes: float) -> LimitsConfig:
    return LIMITS.model_copy(update=changes)
