"""One drive as the bridge sees it: its parameters, PDOs and scale, and what it last reported (CiA 402)."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, field
from typing import Literal

from common.canopen.cia402 import (
    CHANGE_AT_ONCE,
    FAULT_RESET,
    NEW_SETPOINT,
    START_HOMING,
    STATUS_HOMING_ATTAINED,
    STATUS_SETPOINT_ACKNOWLEDGE,
    DriveState,
    Mode,
    Target,
    controlword,
    decode_statusword,
)
from common.canopen.frames import RPDO, CanFrame, Emergency
from common.canopen.node import CanopenNode, MappedObject
from common.config import DriveConfig
from common.errors import DeviceError

Group = Literal["wheels", "arms"]
Parameter = tuple[int, int, int]
CONTROLWORD: MappedObject = (0x6040, 0, 16)
STATUSWORD: MappedObject = (0x6041, 0, 16)
TARGET_VELOCITY: MappedObject = (0x60FF, 0, 32)
TARGET_TORQUE: MappedObject = (0x6071, 0, 16)
TARGET_POSITION: MappedObject = (0x607A, 0, 32)
POSITION: MappedObject = (0x6064, 0, 32)
VELOCITY: MappedObject = (0x606C, 0, 32)
TORQUE: MappedObject = (0x6077, 0, 16)

_QUICK_STOP_THEN_OFF = 2
_QUICK_STOP_AND_HOLD = 6
_ABORT_BY_QUICK_STOP = 3
_INT32 = 1 << 32
MOST_TORQUE_N_M = 1000.0  # no joint or gripper of these robots gives more: a frame that says so is not genuine
# most answers that can be due: as many cycles as the drives wait before their watchdogs stop them
OUTSTANDING = 8


@dataclass
class Axis:
    """One drive. Values are at the output shaft: rad, or metres for the lift, by ``units_per_turn``.

    ``expected`` counts, for each TPDO, the answers to SYNC that are still due: one that is not due is a replay.
    """

    name: str
    config: DriveConfig
    group: Group
    mode: Mode
    units_per_turn: float = 2 * math.pi
    extra: tuple[Parameter, ...] = ()
    state: DriveState = DriveState.UNKNOWN
    statusword: int = 0
    status_ns: int = -1
    position: float = 0.0
    velocity: float = 0.0
    torque_n_m: float = 0.0
    was_enabled: bool = False
    emergencies: dict[int, Emergency] = field(default_factory=dict)
    expected: list[int] = field(default_factory=lambda: [0, 0])
    _raw_position: int | None = None
    _counts: int = 0
    _setpoint_sent: int | None = None

    @property
    def node_id(self) -> int:
        """CANopen node id."""
        return self.config.node_id

    @property
    def counts_per_unit(self) -> float:
        """Encoder counts (of 6064h, 607Ah, 60FFh per second) per unit of the output shaft, with its sign."""
        return self.config.counts_per_turn * self.config.gear_ratio * self.config.sign / self.units_per_turn

    @property
    def permille_per_n_m(self) -> float:
        """Per mille of the motor's rated torque (6071h, 6077h) per N·m at the output shaft, with its sign."""
        return 1000.0 * self.config.sign / (self.config.rated_torque_n_m * self.config.gear_ratio)

    @property
    def zero_counts(self) -> int:
        """Encoder counts at the axis' zero: absolute, or counted from the home position."""
        homing = self.config.homing
        return self.config.zero_counts if homing is None else -round(homing.position * self.counts_per_unit)

    @property
    def holds_in_quick_stop(self) -> bool:
        """Arms keep their position when stopped, so that nothing is released; wheels go free once they stand."""
        return self.group == "arms"

    def parameters(self) -> tuple[Parameter, ...]:
        """Objects to write at bring-up: docs/safety.md, layer 1, then mode and ramps."""
        return (
            (0x6007, 0, _ABORT_BY_QUICK_STOP),
            (0x605A, 0, _QUICK_STOP_AND_HOLD if self.holds_in_quick_stop else _QUICK_STOP_THEN_OFF),
            (0x6072, 0, self.config.max_torque_permille),
            (0x6060, 0, int(self.mode)),
            *self.extra,
        )

    def restart(self) -> None:
        """Forget what an earlier connection reported."""
        self.state, self.statusword, self.status_ns = DriveState.UNKNOWN, 0, -1
        self.was_enabled = False
        self.emergencies.clear()
        self.expected = [0, 0]
        self._raw_position = self._setpoint_sent = None

    def configure(self, node: CanopenNode) -> None:
        """Write parameters and PDO mappings, read the state.

        Raises:
            DeviceError: the node refuses, keeps another value or is silent; or the axis is not homed.
        """
        if self.config.homing is not None and self.mode is not Mode.HOMING:
            self._check_homed(node)
        for index, subindex, value in self.parameters():
            node.write(index, subindex, value)
        rated = round(self.config.rated_torque_n_m * 1000.0)
        node.expect(0x6076, 0, rated, "rated torque in mN·m")
        for number, objects in enumerate(self.transmit_pdos(), start=1):
            node.map_transmit_pdo(number, objects)
        node.map_receive_pdo(1, self.receive_pdo())
        self._set_status(node.read(0x6041))
        self._set_position(node.read(0x6064))

    def _check_homed(self, node: CanopenNode) -> None:
        """In mode 6 the statusword shows whether home was found since the drive was switched on."""
        node.write(0x6060, 0, int(Mode.HOMING))
        if not node.read(0x6041) & STATUS_HOMING_ATTAINED:
            raise DeviceError(f"node {self.node_id} ({self.name}): not homed: run davpc can home, with the arms free")

    def receive_pdo(self) -> tuple[MappedObject, ...]:
        """Mapping of the RPDO: the controlword, and the set-point of this mode."""
        target = self._target_object()
        return (CONTROLWORD,) if target is None else (CONTROLWORD, target)

    def transmit_pdos(self) -> tuple[tuple[MappedObject, ...], ...]:
        """Mapping of the TPDOs: what the axis measures in this mode."""
        if self.mode is Mode.PROFILE_VELOCITY:
            return (STATUSWORD, VELOCITY, TORQUE), (POSITION,)
        if self.mode is Mode.PROFILE_TORQUE:
            return ((STATUSWORD, POSITION, TORQUE),)
        return ((STATUSWORD, POSITION),)

    def command(self, target: Target, setpoint: float | None, reset: bool) -> CanFrame:
        """RPDO: the controlword of the next transition, and the set-point [rad/s, N·m or m].

        A speed or a position is sent in operation only, a torque from the first controlword that leads there: a drive
        ignores it until then.

        Args:
            target: where the drive shall go.
            setpoint: in operation; None leaves a position drive where it is, and is zero for the others.
            reset: send fault reset in place of the next transition.
        """
        word = FAULT_RESET if reset else controlword(self.state, target, self.holds_in_quick_stop)
        running = self.state is DriveState.ENABLED and target is Target.ENABLED
        wanted = setpoint if running and setpoint is not None else 0.0
        if self.mode is Mode.HOMING:
            data = struct.pack("<H", word | START_HOMING if running else word)
        elif self.mode is Mode.PROFILE_TORQUE:
            limit = self.config.max_torque_permille
            # with the controlword that enables: a gripper whose first torque came a frame later would open
            torque = setpoint if target is Target.ENABLED and setpoint is not None else 0.0
            data = struct.pack("<Hh", word, max(-limit, min(limit, round(torque * self.permille_per_n_m))))
        elif self.mode is Mode.PROFILE_VELOCITY:
            data = struct.pack("<Hi", word, _clamp32(wanted * self.counts_per_unit))
        else:
            data = self._position_command(word, setpoint if running else None)
        return CanFrame(RPDO[0] + self.node_id, data)

    def handle_pdo(self, pdo: int, data: bytes, stamp_ns: int) -> bool:
        """Take a TPDO (0 or 1) of this drive, sampled at ``stamp_ns``; false when it cannot be genuine."""
        if len(data) != _LENGTHS[self.mode][pdo] or self.expected[pdo] <= 0:
            return False
        self.expected[pdo] -= 1
        if pdo == 1:
            self._set_position(struct.unpack("<i", data)[0])
        elif self.mode in (Mode.PROFILE_VELOCITY, Mode.PROFILE_TORQUE):
            status, moved, permille = struct.unpack("<Hih", data)
            torque_n_m = permille / self.permille_per_n_m
            if abs(torque_n_m) > MOST_TORQUE_N_M:
                return False
            self.torque_n_m = torque_n_m
            if self.mode is Mode.PROFILE_VELOCITY:
                self.velocity = moved / self.counts_per_unit
            else:
                self._set_position(moved)
            self._set_status(status)
        else:
            status, position = struct.unpack("<Hi", data)
            self._set_position(position)
            self._set_status(status)
        if pdo == 0:
            self.status_ns = stamp_ns
        return True

    def synchronised(self) -> None:
        """A SYNC went out: one more answer to each TPDO is due."""
        self.expected = [min(count + 1, OUTSTANDING) for count in self.expected]

    def _set_status(self, statusword: int) -> None:
        self.statusword = statusword
        self.state = decode_statusword(statusword)

    def _set_position(self, raw: int) -> None:
        """Unwrap the encoder's 32-bit counter; an absolute encoder is read at start in place of homing."""
        previous = raw if self._raw_position is None else self._raw_position
        if self._raw_position is None:
            self._counts = raw
        self._counts += (raw - previous + _INT32 // 2) % _INT32 - _INT32 // 2
        self._raw_position = raw
        self.position = (self._counts - self.zero_counts) / self.counts_per_unit

    def _target_object(self) -> MappedObject | None:
        return {
            Mode.PROFILE_VELOCITY: TARGET_VELOCITY,
            Mode.PROFILE_TORQUE: TARGET_TORQUE,
            Mode.PROFILE_POSITION: TARGET_POSITION,
        }.get(self.mode)

    def _position_command(self, word: int, setpoint: float | None) -> bytes:
        """CiA 402 set-point handshake: raise bit 4 with a new target, lower it when bit 12 acknowledges."""
        if setpoint is None:
            self._setpoint_sent = None
            return struct.pack("<Hi", word, 0)
        wanted = _clamp32(setpoint * self.counts_per_unit + self.zero_counts)
        if not self.statusword & STATUS_SETPOINT_ACKNOWLEDGE and wanted != self._setpoint_sent:
            word |= NEW_SETPOINT | CHANGE_AT_ONCE
            self._setpoint_sent = wanted
        return struct.pack("<Hi", word, self._setpoint_sent or 0)


_LENGTHS: dict[Mode, tuple[int, int]] = {
    Mode.PROFILE_VELOCITY: (8, 4),
    Mode.PROFILE_TORQUE: (8, -1),
    Mode.PROFILE_POSITION: (6, -1),
    Mode.HOMING: (6, -1),
}


def _clamp32(value: float) -> int:
    return max(-(_INT32 // 2), min(_INT32 // 2 - 1, round(value)))
