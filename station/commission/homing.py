"""``davpc can home``: axes without an absolute encoder find their home, one after the other (CiA 402 mode 6).

Homing moves an axis by itself, so it happens on the operator's command only; a bridge refuses axes that are not
homed.
The heartbeat runs meanwhile: when this ends for whatever reason, the drives stop by themselves.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from common.canopen.cia402 import STATUS_HOMING_ATTAINED, STATUS_HOMING_ERROR, STATUS_TARGET_REACHED, DriveState
from common.config import Config, HomingConfig
from common.errors import ConfigError
from common.timing import NS_PER_S
from follower.can_bridge.axes import Axis
from follower.can_bridge.drive_bus import DriveBus
from follower.can_bridge.measurement import BusMeasurement, DriveSetpoint
from station.commission.enable_test import Check, SleepingClock

_PERIOD_NS = NS_PER_S // 100
# a statusword from before the start must not count as attained
_BEGUN_CYCLES = 5


class Homing:
    """Homes every axis that is configured so; the first that fails ends it with everything stopped."""

    def __init__(self, config: Config, config_path: Path, clock: SleepingClock) -> None:
        if not any(drive.homing is not None for drive in config.follower_can.drives):
            raise ConfigError(
                f"{config_path}: follower_can: no drive has homing: absolute encoders are read at start"
            )
        self._drives = DriveBus(config.follower_can, config.base, config_path, homing=True)
        self._clock = clock

    def run(self) -> Iterator[Check]:
        """Each axis as it is done.

        Raises:
            DeviceError: the bus or a node is missing or not as configured; named.
        """
        try:
            self._drives.open()
            for axis in self._drives.axes:
                if axis.config.homing is None:
                    continue
                check = self._home(axis, axis.config.homing)
                yield check
                if not check.passed:
                    return
        finally:
            self._drives.close()

    def _home(self, axis: Axis, homing: HomingConfig) -> Check:
        due_ns = self._clock.now_ns()
        end_ns = due_ns + round(homing.timeout_s * NS_PER_S)
        self._drives.home(axis)
        enabled = 0
        while due_ns < end_ns:
            measured = self._drives.exchange(self._clock.now_ns(), DriveSetpoint())
            enabled += axis.state is DriveState.ENABLED
            trouble = _trouble(axis, measured)
            if trouble or (enabled > _BEGUN_CYCLES and _complete(axis)):
                break
            due_ns += _PERIOD_NS
            self._clock.sleep_until(due_ns)
        else:
            trouble = f"home not found in {homing.timeout_s:g} s"
        self._release(due_ns)
        return Check(axis.name, not trouble, trouble or f"home at {homing.position:g}, now at {axis.position:+.4f}")

    def _release(self, due_ns: int) -> None:
        """Power off before the next axis gets it."""
        self._drives.home(None)
        for _ in range(_BEGUN_CYCLES):
            due_ns += _PERIOD_NS
            self._clock.sleep_until(due_ns)
            self._drives.exchange(self._clock.now_ns(), DriveSetpoint())


def _trouble(axis: Axis, measured: BusMeasurement) -> str:
    if measured.troubles:
        return "; ".join(measured.troubles)
    # before the first answers the stop inputs are not known yet
    if measured.measured_ns >= 0 and not (measured.estop_clear and measured.protective_clear):
        return "a stop input is active"
    started = axis.state is DriveState.ENABLED
    return "the drive reports a homing error" if started and axis.statusword & STATUS_HOMING_ERROR else ""


def _complete(axis: Axis) -> bool:
    """Home found and standing: bits 12 and 10."""
    done = STATUS_HOMING_ATTAINED | STATUS_TARGET_REACHED
    return axis.statusword & done == done
