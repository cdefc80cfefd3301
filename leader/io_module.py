"""A CiA 401 I/O module on the bus: the Leader's LED driver, linear actuator and switches."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from common.canopen.bus import BusLostError, CanBus
from common.canopen.frames import (
    NMT_PRE_OPERATIONAL,
    NMT_START,
    RPDO,
    STATE_BOOT_UP,
    STATE_OPERATIONAL,
    SYNC,
    TPDO,
    CanFrame,
    heartbeat_frame,
    nmt_frame,
)
from common.canopen.node import CanopenNode, find_eds
from common.config import LeaderCanConfig
from common.errors import ConfigError
from common.timing import NS_PER_MS

MAX_LEDS = 4
INPUTS_MAX_AGE_MS = 100
_MILLI = 1000.0


@dataclass(frozen=True, kw_only=True)
class ModuleReading:
    """What the Leader's module measured; ``fresh`` is false when it fell silent."""

    fresh: bool
    led_current_a: tuple[float, ...]
    actuator_current_a: float
    guide_lifted: bool
    beam_seated: bool
    lock_extended: bool
    lock_retracted: bool


class LeaderIo:
    """LED currents and actuator outputs out, currents and switches in, once per :meth:`exchange`.

    Analogue values are in mA. Digital outputs: bit 0 extend, bit 1 retract; digital inputs: bit 0 guide lifted,
    1 beam seated, 2 lock extended, 3 lock retracted.
    """

    def __init__(self, config: LeaderCanConfig, config_path: Path, leds: int) -> None:
        if leds > MAX_LEDS:
            raise ConfigError(f"{config_path}: leds.positions_m: {leds} LEDs, the I/O module drives {MAX_LEDS}")
        self._config = config
        self._eds = find_eds(config.io_eds, config_path)
        self._leds = leds
        self._bus: CanBus | None = None
        self._milliamps = (0, 0, 0, 0)
        self._outputs = 0
        self._digital = 0
        self._currents = (0, 0, 0, 0)
        self._actuator = 0
        self._sync_ns = 0
        self._measured_ns = -1
        self._restarted = False

    def open(self) -> None:
        """Open the bus and bring the module up: identity, heartbeats, error modes, PDOs.

        On loss of the Leader's heartbeat the actuator stops where it is and the LEDs stay as they are.

        Raises:
            DeviceError: no bus, no module, another device, a refused write.
            ConfigError: the EDS is missing or not one.
        """
        self.close()
        bus = CanBus(self._config.bus)
        try:
            self._bring_up(bus)
        except BaseException:
            bus.close()
            raise
        self._bus = bus
        self._restarted = False
        self._measured_ns = -1

    def set_led_currents(self, currents_a: Sequence[float]) -> None:
        """Current of each LED [A], from 0 to 5, by LED; limited to that range."""
        if len(currents_a) != self._leds:
            raise ValueError(f"{len(currents_a)} currents for {self._leds} LEDs")
        values = [round(min(max(current, 0.0), 5.0) * _MILLI) for current in currents_a]
        self._milliamps = tuple(values + [0] * (MAX_LEDS - len(values)))  # type: ignore[assignment]

    def drive_actuator(self, direction: int) -> None:
        """Extend (1), retract (−1) or stop (0) the linear actuator of the lock."""
        self._outputs = {1: 0b01, -1: 0b10, 0: 0}[direction]

    def exchange(self, now_ns: int) -> ModuleReading:
        """Take what has arrived, send outputs, heartbeat and SYNC.

        Raises:
            BusLostError: the bus went away, or the module restarted; :meth:`open` it again.
        """
        if self._bus is None:
            raise BusLostError(f"CAN bus {self._config.bus.channel}: not open")
        for frame in self._bus.receive():
            self._take(frame)
        node_id = self._config.io_node_id
        if self._restarted:
            self.close()
            raise BusLostError(f"leader I/O: node {node_id} restarted and has lost its configuration")
        self._bus.send(heartbeat_frame(self._config.master_node_id, STATE_OPERATIONAL))
        self._bus.send(CanFrame(RPDO[0] + node_id, bytes((self._outputs,))))
        self._bus.send(CanFrame(RPDO[1] + node_id, struct.pack("<4h", *self._milliamps)))
        self._bus.send(CanFrame(SYNC, b""))
        self._sync_ns = now_ns
        return self._inputs(now_ns)

    def close(self) -> None:
        """Stop the actuator, leave the LEDs as they are, close the bus."""
        bus, self._bus = self._bus, None
        if bus is None:
            return
        try:
            bus.send(CanFrame(RPDO[0] + self._config.io_node_id, b"\0"))
            bus.send(CanFrame(SYNC, b""))
        except BusLostError:
            pass  # the module's own watchdog stops the actuator
        finally:
            bus.close()

    def _bring_up(self, bus: CanBus) -> None:
        node_id = self._config.io_node_id
        node = CanopenNode(bus, node_id, "leader I/O", self._eds)
        bus.send(nmt_frame(NMT_PRE_OPERATIONAL, node_id))
        node.check_identity()
        node.supervise(self._config.master_node_id, self._config.watchdog_ms)
        node.write(0x6206, 1, 0xFF)
        node.write(0x6207, 1, 0)
        for channel in range(1, MAX_LEDS + 1):
            node.write(0x6443, channel, 0)
        node.map_receive_pdo(1, [(0x6200, 1, 8)])
        node.map_receive_pdo(2, [(0x6411, channel, 16) for channel in range(1, MAX_LEDS + 1)])
        node.map_transmit_pdo(1, [(0x6000, 1, 8), (0x6401, 5, 16)])
        node.map_transmit_pdo(2, [(0x6401, channel, 16) for channel in range(1, MAX_LEDS + 1)])
        bus.receive()
        bus.send(nmt_frame(NMT_START, node_id))

    def _take(self, frame: CanFrame) -> None:
        node_id = self._config.io_node_id
        if frame.can_id == TPDO[0] + node_id and len(frame.data) == 3:
            self._digital, self._actuator = struct.unpack("<Bh", frame.data)
            self._measured_ns = self._sync_ns
        elif frame.can_id == TPDO[1] + node_id and len(frame.data) == 8:
            self._currents = struct.unpack("<4h", frame.data)
        elif frame == heartbeat_frame(node_id, STATE_BOOT_UP):
            self._restarted = True

    def _inputs(self, now_ns: int) -> ModuleReading:
        bits = self._digital
        fresh = self._measured_ns >= 0 and now_ns - self._measured_ns <= INPUTS_MAX_AGE_MS * NS_PER_MS
        return ModuleReading(
            fresh=fresh,
            led_current_a=tuple(value / _MILLI for value in self._currents[: self._leds]),
            actuator_current_a=max(self._actuator, 0) / _MILLI,
            guide_lifted=bool(bits & 1),
            beam_seated=bool(bits & 2),
            lock_extended=bool(bits & 4),
            lock_retracted=bool(bits & 8),
        )
