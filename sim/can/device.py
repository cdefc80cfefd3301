"""A simulated CANopen device: dictionary, SDO server, NMT, heartbeats both ways, EMCY, mapped PDOs on SYNC (CiA 301).

Dictionary and SDO server are those of the ``canopen`` library, which lacks the rest. Not modelled: block transfer,
event- and time-driven PDOs, COB-IDs other than the predefined connection set, LSS.
"""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

from canopen.objectdictionary import NUMBER_TYPES
from canopen.sdo.exceptions import SdoAbortedError
from canopen.sdo.server import SdoServer

from common.canopen.eds import load_device_file
from common.canopen.frames import (
    HEARTBEAT,
    HEARTBEAT_LOST,
    NMT,
    NMT_PRE_OPERATIONAL,
    NMT_RESET_COMMUNICATION,
    NMT_RESET_NODE,
    NMT_START,
    NMT_STOP,
    RPDO,
    SDO_REQUEST,
    SDO_RESPONSE,
    STATE_BOOT_UP,
    STATE_OPERATIONAL,
    STATE_PRE_OPERATIONAL,
    STATE_STOPPED,
    SYNC,
    TPDO,
    CanFrame,
    Emergency,
    emergency_frame,
    heartbeat_frame,
)
from common.timing import NS_PER_MS
from sim.can.dictionary import ObjectValues, check_limits, initial_values
from sim.can.pdo import Key, PdoTable

PDO_TOO_SHORT = 0x8210
_SLOWEST_SYNCHRONOUS = 240
_COMMUNICATION_ERROR = 0x10
_ABORT_NO_OBJECT = 0x06020000
_ABORT_LENGTH = 0x06070010
_ABORT_WRITE_ONLY = 0x06010001
_ABORT_READ_ONLY = 0x06010002


class CanopenDevice:
    """One device on a simulated bus. Subclasses give the objects their effect."""

    def __init__(self, node_id: int, eds: Path, serial: int = 0) -> None:
        logging.getLogger("canopen").setLevel(logging.CRITICAL)  # the library logs each refused transfer
        self.node_id = node_id
        self._file = load_device_file(eds, node_id)
        self.object_dictionary: Any = self._file.dictionary
        self.values: dict[Key, int] = ObjectValues()
        self._texts: dict[Key, bytes] = {}
        self._outbox: list[CanFrame] = []
        self._pending: dict[int, bytes] = {}
        self._now_ns = 0
        self._syncs = 0
        self._next_heartbeat_ns = 0
        self._heartbeat_ns: int | None = None
        self.heartbeat_lost = False
        self.nmt_state = STATE_BOOT_UP
        make_server: Any = SdoServer
        self._sdo = make_server(SDO_REQUEST + node_id, SDO_RESPONSE + node_id, self)
        self._sdo.network = self
        self._pdos = PdoTable(node_id, self.values, self._variable)
        self._load_defaults()
        self.values[0x1018, 4] = serial

    # -- the bus side

    def handle(self, frame: CanFrame, now_ns: int) -> list[CanFrame]:
        """React to a frame of the master; the frames that the device sends in return, in order."""
        self.advance(now_ns)
        service, data = frame.can_id, frame.data
        if service == NMT:
            if len(data) == 2 and data[1] in (0, self.node_id):
                self._command(data[0])
        elif service == SYNC:
            if self.nmt_state == STATE_OPERATIONAL:
                self._synchronise()
        elif service == SDO_REQUEST + self.node_id:
            if self.nmt_state != STATE_STOPPED and len(data) == 8:
                self._sdo.on_request(service, data, 0.0)
        elif service & 0x780 == HEARTBEAT:
            self._take_heartbeat(service & 0x7F)
        elif self.nmt_state == STATE_OPERATIONAL:
            self._take_pdo(service, data)
        return self._flush()

    def tick(self, now_ns: int) -> list[CanFrame]:
        """Frames that the device sends by itself at this time: boot-up, heartbeat, emergencies."""
        self.advance(now_ns)
        if self.nmt_state == STATE_BOOT_UP:
            self._boot()
        period_ms = self.values[0x1017, 0]
        if period_ms and now_ns >= self._next_heartbeat_ns:
            self._outbox.append(heartbeat_frame(self.node_id, self.nmt_state))
            self._next_heartbeat_ns = now_ns + period_ms * NS_PER_MS
        return self._flush()

    def advance(self, now_ns: int) -> None:
        """Advance to ``now_ns``: watchdog first, then the motion."""
        if now_ns <= self._now_ns:
            return
        elapsed_s = (now_ns - self._now_ns) * 1e-9 if self._now_ns else 0.0
        self._now_ns = now_ns
        watch_ms = self.values[0x1016, 1] & 0xFFFF
        if self._heartbeat_ns is not None and watch_ms and now_ns - self._heartbeat_ns > watch_ms * NS_PER_MS:
            self._heartbeat_ns = None
            self.heartbeat_lost = True
            self.emergency(HEARTBEAT_LOST, _COMMUNICATION_ERROR)
            self._communication_lost()
        self.moved(elapsed_s)

    def excuse_stall(self, stall_ns: int) -> None:
        """The simulation itself stalled: extend the watchdog, since the master was not silent."""
        if self._heartbeat_ns is not None:
            self._heartbeat_ns += stall_ns

    def emergency(self, code: int, register: int) -> None:
        """Send an EMCY and set the error register (1001h)."""
        self.values[0x1001, 0] = register
        self._outbox.append(emergency_frame(self.node_id, Emergency(code, register, bytes(5))))

    # -- what subclasses fill in

    def moved(self, elapsed_s: float) -> None:
        """Time has passed."""

    def written(self, key: Key) -> None:
        """An object has a new value, by SDO or by an RPDO taken over at SYNC."""

    def sampled(self) -> None:
        """Bring measured objects up to date, before a TPDO or an SDO upload shows them."""

    def heartbeat_missed(self) -> None:
        """The consumer heartbeat time (1016h) ran out."""

    def stopped(self) -> None:
        """NMT took the device out of operation."""

    # -- dictionary, as the library's SDO server calls it

    def send_message(self, can_id: int, data: bytes) -> None:
        """Send a frame of the SDO server."""
        self._outbox.append(CanFrame(can_id, bytes(data)))

    def get_data(self, index: int, subindex: int, check_readable: bool = False) -> bytes:
        """Raw value of an object."""
        variable = self._variable(index, subindex)
        if check_readable and not variable.readable:
            raise SdoAbortedError(_ABORT_WRITE_ONLY)
        self.sampled()
        key = (index, subindex)
        return self._texts[key] if key in self._texts else bytes(variable.encode_raw(self.values[key]))

    def set_data(self, index: int, subindex: int, data: bytes, check_writable: bool = False) -> None:
        """Write a number by SDO.

        Args:
            index, subindex: the object.
            data: little-endian value, as long as the object's type.
            check_writable: refuse objects that are read-only to a client.

        Raises:
            SdoAbortedError: no such object, read-only, wrong length, or out of range.
        """
        variable = self._variable(index, subindex)
        if check_writable and not variable.writable:
            raise SdoAbortedError(_ABORT_READ_ONLY)
        if variable.data_type not in NUMBER_TYPES or len(variable) != 8 * len(data):
            raise SdoAbortedError(_ABORT_LENGTH)
        value = int(variable.decode_raw(bytes(data)))
        check_limits(variable, value)
        self._write(index, subindex, value)

    # -- inside

    def _load_defaults(self) -> None:
        numbers, texts = initial_values(self.object_dictionary)
        self.values.update(numbers)
        self._texts.update(texts)
        for subindex, what in ((1, "vendor"), (2, "product")):
            self.values[0x1018, subindex] = next(iter(self._file.identity[what]), 0)
        self._pdos.load()

    def _variable(self, index: int, subindex: int) -> Any:
        variable = self.object_dictionary.get_variable(index, subindex)
        if variable is None:
            raise SdoAbortedError(_ABORT_NO_OBJECT)
        return variable

    def _write(self, index: int, subindex: int, value: int) -> None:
        if 0x1400 <= index < 0x1C00:
            self._pdos.configure(index, subindex, value)
        self.values[index, subindex] = value
        if index == 0x1016:
            self._heartbeat_ns, self.heartbeat_lost = None, False
        elif index == 0x1017:
            self._next_heartbeat_ns = self._now_ns
        self.written((index, subindex))

    def _boot(self) -> None:
        self._outbox.append(heartbeat_frame(self.node_id, STATE_BOOT_UP))
        self.nmt_state = STATE_PRE_OPERATIONAL

    def _command(self, command: int) -> None:
        if command == NMT_START:
            self.nmt_state = STATE_OPERATIONAL
        elif command in (NMT_STOP, NMT_PRE_OPERATIONAL):
            self._leave(STATE_STOPPED if command == NMT_STOP else STATE_PRE_OPERATIONAL)
        elif command in (NMT_RESET_NODE, NMT_RESET_COMMUNICATION):
            self._leave(STATE_BOOT_UP)
            self._load_communication_defaults()
            self._boot()

    def _leave(self, state: int) -> None:
        was_operational = self.nmt_state == STATE_OPERATIONAL
        self.nmt_state = state
        self._pending.clear()
        if was_operational:
            self.stopped()

    def _load_communication_defaults(self) -> None:
        serial = self.values[0x1018, 4]
        kept = {key: value for key, value in self.values.items() if key[0] >= 0x2000}
        self._load_defaults()
        self.values.update(kept)
        self.values[0x1018, 4] = serial
        self._heartbeat_ns, self.heartbeat_lost = None, False

    def _take_heartbeat(self, node_id: int) -> None:
        watched = self.values[0x1016, 1]
        if watched & 0xFFFF and watched >> 16 & 0x7F == node_id:
            self._heartbeat_ns = self._now_ns
            if self.heartbeat_lost:
                self.heartbeat_lost = False
                if not self.values.get((0x603F, 0)):  # nothing else is wrong
                    self.emergency(0x0000, 0x00)

    def _communication_lost(self) -> None:
        self.heartbeat_missed()
        behaviour = self.values[0x1029, 1]
        if behaviour == 0 and self.nmt_state == STATE_OPERATIONAL:
            self._leave(STATE_PRE_OPERATIONAL)
        elif behaviour == 2:
            self._leave(STATE_STOPPED)

    def _take_pdo(self, cob_id: int, data: bytes) -> None:
        pdo = self._pdos.receive.get(cob_id)
        if pdo is None:
            return
        if len(data) != pdo.codec.size:
            self.emergency(PDO_TOO_SHORT, _COMMUNICATION_ERROR)
            return
        parameters = 0x1400 + RPDO.index(cob_id - self.node_id)
        if self.values[parameters, 2] <= 1:
            self._pending[cob_id] = data
        else:
            self._apply(cob_id, data)

    def _apply(self, cob_id: int, data: bytes) -> None:
        pdo = self._pdos.receive[cob_id]
        self.values.update(zip(pdo.keys, pdo.codec.unpack(data), strict=True))
        for key in pdo.keys:
            self.written(key)

    def _synchronise(self) -> None:
        """SYNC: take over the RPDOs that came since the last one, send every TPDO."""
        pending, self._pending = self._pending, {}
        for cob_id, data in pending.items():
            self._apply(cob_id, data)
        self.sampled()
        values = self.values
        self._syncs += 1
        for cob_id, pdo in self._pdos.transmit.items():
            kind = values[0x1800 + TPDO.index(cob_id - self.node_id), 2]
            if not 1 <= kind <= _SLOWEST_SYNCHRONOUS or self._syncs % kind:
                continue
            self._outbox.append(CanFrame(cob_id, pdo.codec.pack(*[values[key] for key in pdo.keys])))

    def _flush(self) -> list[CanFrame]:
        sent, self._outbox = self._outbox, []
        return sent
