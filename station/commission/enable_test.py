"""``davpc can enable-test``: wheels up, arms free: each axis, each direction, each limit, the watchdog."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

from common.canopen.cia402 import DriveState
from common.ceilings import HARD_WHEEL_SPEED_M_S
from common.config import Config
from common.timing import NS_PER_MS, NS_PER_S, Clock
from follower.can_bridge.drive_bus import DriveBus
from follower.can_bridge.measurement import BusMeasurement, DriveSetpoint

SURFACE_SPEED_M_S = 0.1
BEYOND_M_S = 1.0
TORQUE_N_M = 1.0
LIFT_STEP_M = 0.01
MOVES_RAD = 0.003
WATCHDOG_LIMIT_MS = 120.0
_PERIOD_NS = NS_PER_S // 100
_SPEED_TOLERANCE = 0.2
_LIFT_TOLERANCE_M = 0.001
_TORQUE_TOLERANCE = 0.3
_JOINTS, _GRIPPERS = range(6), range(6, 8)


class SleepingClock(Clock, Protocol):
    """A clock that can be waited for: the machine's, or a simulation's."""

    def sleep_until(self, deadline_ns: int) -> None:
        """Return at or after the deadline."""


@dataclass(frozen=True)
class Check:
    """One thing that was tried, whether it went as it should, and what was measured."""

    name: str
    passed: bool
    result: str


class EnableTest:
    """Runs the checks one after the other; the first that fails ends it with everything stopped."""

    def __init__(self, config: Config, config_path: Path, clock: SleepingClock) -> None:
        self._config = config
        self._drives = DriveBus(config.follower_can, config.base, config_path)
        self._clock = clock
        self._measured: BusMeasurement | None = None
        self._moved: set[int] = set()

    def run(self) -> Iterator[Check]:
        """Every check as it is done. Whatever happens, the drives are quick-stopped at the end.

        Raises:
            DeviceError: the bus or a node is missing or not as configured; named.
        """
        try:
            self._drives.open()
            for check in self._checks():
                yield check
                if not check.passed:
                    return
        finally:
            self._drives.close()

    def _checks(self) -> Iterator[Check]:
        yield self._enable()
        for side in (0, 1):
            for direction in (1.0, -1.0):
                yield self._wheel(side, direction * SURFACE_SPEED_M_S)
        yield self._speed_limit()
        # the fingers first, opening last: they release what would hold the joints
        for joint in (*_GRIPPERS, *_JOINTS):
            for direction in (1.0, -1.0):
                yield self._torque(joint, direction * TORQUE_N_M)
            yield self._moves(joint)
        start_m = self._now().lift_m
        for height_m in (start_m + LIFT_STEP_M, start_m):
            yield self._lift(height_m)
        yield self._watchdog()

    def _now(self) -> BusMeasurement:
        assert self._measured is not None
        return self._measured

    def _hold(self, setpoint: DriveSetpoint, seconds: float) -> BusMeasurement:
        """Exchange at 100 Hz for so long; the last measurement."""
        due_ns = self._clock.now_ns()
        for _ in range(round(seconds * 100)):
            self._measured = self._drives.exchange(self._clock.now_ns(), setpoint)
            due_ns += _PERIOD_NS
            self._clock.sleep_until(due_ns)
        return self._now()

    def _check(self, name: str, passed: bool, result: str) -> Check:
        troubles = self._now().troubles
        return Check(name, passed and not troubles, "; ".join((result, *troubles)))

    def _enable(self) -> Check:
        self._drives.enable()
        measured = self._hold(DriveSetpoint(), 0.3)
        enabled = sum(state is DriveState.ENABLED for state in measured.states)
        return self._check(
            "all drives in operation", measured.wheels_enabled and measured.arms_enabled, f"{enabled} of 11"
        )

    def _wheel(self, side: int, surface_m_s: float) -> Check:
        """One wheel turns as commanded, the other stands."""
        radius = self._config.base.wheel_radius_m
        commanded = [0.0, 0.0]
        commanded[side] = surface_m_s
        speeds = self._hold(
            DriveSetpoint(left_rad_s=commanded[0] / radius, right_rad_s=commanded[1] / radius), 0.8
        ).wheel_speed_rad_s
        measured = [speed * radius for speed in speeds]
        self._hold(DriveSetpoint(), 0.4)
        right = abs(measured[side] - surface_m_s) <= _SPEED_TOLERANCE * abs(surface_m_s)
        still = abs(measured[1 - side]) <= _SPEED_TOLERANCE * abs(surface_m_s)
        name = f"{('left', 'right')[side]} wheel {'forward' if surface_m_s > 0 else 'backward'}"
        return self._check(name, right and still, f"measured left {measured[0]:+.3f}, right {measured[1]:+.3f} m/s")

    def _speed_limit(self) -> Check:
        """The drive's own limit holds against a set-point beyond it."""
        radius = self._config.base.wheel_radius_m
        beyond = BEYOND_M_S / radius
        speeds = self._hold(DriveSetpoint(left_rad_s=beyond, right_rad_s=beyond), 1.5).wheel_speed_rad_s
        fastest = max(abs(speed) for speed in speeds) * radius
        self._hold(DriveSetpoint(), 1.5)
        bound = HARD_WHEEL_SPEED_M_S * (1.0 + 0.02)
        return self._check(
            "wheels' speed limit", fastest <= bound, f"commanded {BEYOND_M_S}, measured {fastest:.3f} m/s"
        )

    def _torque(self, joint: int, torque_n_m: float) -> Check:
        """A joint gives the commanded torque, and does not move against it; fingers may move instead."""
        joints, grips = [0.0] * 6, [0.0] * 2
        (joints if joint in _JOINTS else grips)[joint % 6] = torque_n_m
        setpoint = DriveSetpoint(joint_torque_n_m=tuple(joints), grip_torque_n_m=(grips[0], grips[1]))
        before_rad = _angles(self._now())[joint]
        measured = self._hold(setpoint, 0.2)
        given = (*measured.joint_torque_n_m, *measured.grip_torque_n_m)[joint]
        # positive torque closes the fingers, whose angle then falls
        sign = 1.0 if joint in _JOINTS else -1.0
        moved_rad = sign * (_angles(measured)[joint] - before_rad)
        self._hold(DriveSetpoint(), 0.1)
        gives = abs(given - torque_n_m) <= _TORQUE_TOLERANCE * abs(torque_n_m)
        follows = moved_rad * torque_n_m > 0.0 and abs(moved_rad) > MOVES_RAD
        against = moved_rad * torque_n_m < 0.0 and abs(moved_rad) > MOVES_RAD
        if follows:
            self._moved.add(joint)
        agrees = not against and (gives or (follows and joint in _GRIPPERS))
        name = f"{self._drives.axes[2 + joint].name} {'+' if torque_n_m > 0 else '−'}"
        return self._check(
            name, agrees, f"commanded {torque_n_m:+.1f}, measured {given:+.2f} N·m, moved {sign * moved_rad:+.3f} rad"
        )

    def _moves(self, joint: int) -> Check:
        """At a stop an axis moves in one direction only; one that moves in none is blocked, or its encoder stuck."""
        return self._check(
            f"{self._drives.axes[2 + joint].name} moves",
            joint in self._moved,
            "as commanded"
            if joint in self._moved
            else "in neither direction: blocked, brake on, or its encoder stuck",
        )

    def _lift(self, height_m: float) -> Check:
        measured = self._hold(DriveSetpoint(lift_m=height_m), 1.5)
        reached = abs(measured.lift_m - height_m) <= _LIFT_TOLERANCE_M
        return self._check(
            "lift", reached, f"commanded {height_m * 1000:.1f}, measured {measured.lift_m * 1000:.1f} mm"
        )

    def _watchdog(self) -> Check:
        """Both wheels turning, the heartbeat is withheld: quick stop, latched against what is still commanded."""
        radius = self._config.base.wheel_radius_m
        turning_rad_s = SURFACE_SPEED_M_S / radius
        rolling = DriveSetpoint(left_rad_s=turning_rad_s, right_rad_s=turning_rad_s)
        self._hold(rolling, 0.5)
        silent_ns = self._clock.now_ns() - _PERIOD_NS
        self._drives.heartbeat = False
        for _ in range(50):
            measured = self._hold(rolling, 0.01)
            if not measured.wheels_enabled:
                break
        took_ms = (measured.now_ns - silent_ns) / NS_PER_MS
        self._drives.heartbeat = True
        later = self._hold(rolling, 1.0)
        moved = max(abs(speed) for speed in later.wheel_speed_rad_s) * radius
        stopped = took_ms <= WATCHDOG_LIMIT_MS and moved < 0.01
        # that the drives stopped by themselves is what was asked for
        self._measured = replace(later, faults=(), stalled="", silent=(), bad_frames="")
        return self._check(
            "watchdog", stopped, f"quick stop {took_ms:.0f} ms after the last heartbeat, then {moved:.3f} m/s"
        )


def _angles(measured: BusMeasurement) -> tuple[float, ...]:
    return (*measured.joint_angle_rad, *measured.grip_angle_rad)
