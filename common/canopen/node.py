"""Configures CANopen nodes by SDO, each write read back, through single-threaded access to the bus."""

from __future__ import annotations

import queue
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import canopen
from canopen.sdo.client import SdoClient
from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError

from common.canopen.bus import CanBus
from common.canopen.eds import initial_value, load_device_file
from common.canopen.frames import (
    PDO_INVALID,
    PDO_NO_RTR,
    RPDO,
    SDO_REQUEST,
    SDO_RESPONSE,
    TPDO,
    CanFrame,
    consumer_heartbeat,
    mapping,
)
from common.config import default_config_path
from common.errors import ConfigError, DeviceError

SDO_TIMEOUT_S = 0.3
SYNCHRONOUS = 1
HEARTBEAT_MS = 100
"""Period of every node's own heartbeat (1017h)."""
_FOREIGN_FRAMES = 2000
_FIRST_TPDO = 0x1800

MappedObject = tuple[int, int, int]
"""Index, sub-index and length in bits of an object in a PDO."""


class _RefusedError(DeviceError):
    """The node answered an SDO transfer with an abort."""


class _PumpedAnswers(queue.Queue[bytes]):
    """Answer queue of an SDO client without a receive thread: waiting for an answer reads the bus."""

    def __init__(self, bus: CanBus, response_id: int) -> None:
        super().__init__()
        self._bus = bus
        self._response_id = response_id

    def empty(self) -> bool:
        """Discard late answers: the purpose of the client's call."""
        for _ in range(self.qsize()):
            self.get_nowait()
        self._bus.receive()
        return True

    def get(self, block: bool = True, timeout: float | None = None) -> bytes:
        """The next answer of this node; frames of others are skipped."""
        if not block or timeout is None:
            return super().get(block, timeout)
        for _ in range(_FOREIGN_FRAMES):
            frame = self._bus.wait(timeout)
            if frame is None:
                break
            if frame.can_id == self._response_id and len(frame.data) == 8:
                return frame.data
        raise queue.Empty


class _SingleThreadedNetwork(canopen.Network):
    """The library's network without its notifier thread."""

    def __init__(self, bus: CanBus) -> None:
        super().__init__()
        self._can = bus

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        """Send a frame through the bus; remote frames are not used."""
        del remote
        self._can.send(CanFrame(can_id, bytes(data)))


class CanopenNode:
    """One remote node: typed SDO access by its EDS, with errors that name node and object."""

    def __init__(self, bus: CanBus, node_id: int, label: str, eds: Path) -> None:
        self.node_id = node_id
        self.label = label
        self._file = load_device_file(eds, node_id)
        self.dictionary = self._file.dictionary
        self._eds = eds
        # not the library's RemoteNode: it takes every PDO of the EDS to have its mapping there
        make_client: Any = SdoClient
        self._sdo = make_client(SDO_REQUEST + node_id, SDO_RESPONSE + node_id, self.dictionary)
        self._sdo.network = _SingleThreadedNetwork(bus)
        self._sdo.RESPONSE_TIMEOUT = SDO_TIMEOUT_S
        self._sdo.responses = _PumpedAnswers(bus, SDO_RESPONSE + node_id)

    def read(self, index: int, subindex: int = 0) -> int:
        """Value of a number in the node's dictionary.

        Raises:
            DeviceError: no answer, refused, or not in the EDS.
        """
        variable = self._variable(index, subindex)
        raw = self._transfer("read", index, subindex, None)
        try:
            return int(variable.decode_raw(raw))
        except (struct.error, canopen.ObjectDictionaryError) as error:
            raise DeviceError(f"{self._name(index, subindex)}: {len(raw)} bytes do not fit its type") from error

    def has(self, index: int, subindex: int = 0) -> bool:
        """Whether the EDS describes this object."""
        return self.dictionary.get_variable(index, subindex) is not None

    def write(self, index: int, subindex: int, value: int) -> None:
        """Write a number and read it back; one that the node does not let change is accepted if it is right.

        Raises:
            DeviceError: no answer, refused, not in the EDS, or the node keeps another value.
        """
        variable = self._variable(index, subindex)
        try:
            raw = variable.encode_raw(value)
        except (struct.error, ValueError) as error:
            raise DeviceError(f"{self._name(index, subindex)}: {value} does not fit its type") from error
        try:
            self._transfer(f"write of {value}", index, subindex, raw)
        except _RefusedError:
            if self.read(index, subindex) != value:
                raise
            return
        kept = self.read(index, subindex)
        if kept != value:
            raise DeviceError(f"{self._name(index, subindex)}: wrote {value}, the node keeps {kept}")

    def check_identity(self, serial: int = 0) -> tuple[str, ...]:
        """Compare 1000h and 1018h with the EDS, and the serial number unless ``serial`` is 0.

        Returns:
            Warnings: an EDS that gives two numbers, one of which is the node's, or that gives none.

        Raises:
            DeviceError: another device; the text names the object that differs.
        """
        self.expect(0x1000, 0, initial_value(self._variable(0x1000, 0)) or None, "device type")
        warnings = [self._compare(what, subindex) for subindex, what in ((1, "vendor"), (2, "product"))]
        if serial:
            self.expect(0x1018, 4, serial, "serial number")
        return tuple(text for text in warnings if text)

    def _compare(self, what: str, subindex: int) -> str:
        """A warning, or nothing."""
        stated = self._file.identity[what]
        if not stated:
            return f"{self._eds.name}: gives no {what} number: {what} of {self.label} not checked"
        found = self.read(0x1018, subindex)
        if found not in stated:
            wanted = " or ".join(f"{number} ({number:#x})" for number in stated)
            raise DeviceError(
                f"{self._name(0x1018, subindex)}: {what} is {found} ({found:#x}), expected {wanted} "
                f"by {self._eds.name}: is that the EDS of this device?"
            )
        if len(stated) == 1:
            return ""
        places = " and ".join(f"{number:#x}" for number in stated)
        return f"{self._eds.name}: gives two {what} numbers, {places}; {self.label} has {found:#x}"

    def supervise(self, master_id: int, watchdog_ms: int) -> None:
        """Heartbeats both ways: 1017h, 1016h; 1029h keeps the node operational when ours is missing.

        Raises:
            DeviceError: see :meth:`write`.
        """
        self.write(0x1017, 0, HEARTBEAT_MS)
        self.write(0x1016, 1, consumer_heartbeat(master_id, watchdog_ms))
        self.write(0x1029, 1, 1)

    def map_receive_pdo(self, number: int, objects: Sequence[MappedObject]) -> None:
        """Map RPDO ``number`` (from 1), taken over at the next SYNC.

        Raises:
            DeviceError: see :meth:`write`.
        """
        self._map(0x1400, 0x1600, RPDO, number, objects)

    def map_transmit_pdo(self, number: int, objects: Sequence[MappedObject]) -> None:
        """Map TPDO ``number`` (from 1), sent at every SYNC.

        Raises:
            DeviceError: see :meth:`write`.
        """
        self._map(0x1800, 0x1A00, TPDO, number, objects)

    def _map(
        self, parameters: int, mappings: int, base: Sequence[int], number: int, objects: Sequence[MappedObject]
    ) -> None:
        """CiA 301: disable the PDO, empty its mapping, fill it, enable it; only what is not already so is written.

        Bit 30 of a TPDO's COB-ID (no remote requests) is the device's own: it stays as it is.
        """
        parameter, table = parameters + number - 1, mappings + number - 1
        found = self.read(parameter, 1)
        kept = found & PDO_NO_RTR if parameters >= _FIRST_TPDO else 0
        cob_id = base[number - 1] + self.node_id | kept
        entries = [mapping(*entry) for entry in objects]
        mapped, synchronous = self._mapped(table, len(entries)) == entries, self.read(parameter, 2) == SYNCHRONOUS
        if found == cob_id and mapped and synchronous:
            return
        if found != PDO_INVALID | cob_id:
            self._disable(parameter, cob_id, found)
        if not mapped:
            self._fill(table, entries)
        if not synchronous:
            self.write(parameter, 2, SYNCHRONOUS)
        self.write(parameter, 1, cob_id)

    def _disable(self, parameter: int, cob_id: int, found: int) -> None:
        """A COB-ID that is right and cannot be changed stays: the device decides what else may be written then."""
        try:
            self.write(parameter, 1, PDO_INVALID | cob_id)
        except _RefusedError:
            if found != cob_id:
                raise

    def _mapped(self, table: int, count: int) -> list[int]:
        """Mapping entries as the node has them; empty if it maps another number of objects."""
        if self.read(table, 0) != count:
            return []
        return [self.read(table, subindex) for subindex in range(1, count + 1)]

    def _fill(self, table: int, entries: Sequence[int]) -> None:
        try:
            self.write(table, 0, 0)
            for subindex, entry in enumerate(entries, start=1):
                self.write(table, subindex, entry)
            self.write(table, 0, len(entries))
        except _RefusedError as error:
            wanted = ", ".join(f"{entry >> 16:04X}h:{entry >> 8 & 0xFF:02X}" for entry in entries)
            raise DeviceError(f"{error}; its mapping has to be {wanted}") from error

    def expect(self, index: int, subindex: int, wanted: int | None, what: str) -> None:
        """Read a number and compare it.

        Args:
            index, subindex: the object.
            wanted: expected value; None accepts any.
            what: name of the value, for the error.

        Raises:
            DeviceError: another value; the text names the object and both values.
        """
        found = self.read(index, subindex)
        if wanted is not None and found != wanted:
            raise DeviceError(
                f"{self._name(index, subindex)}: {what} is {found} ({found:#x}), expected {wanted} ({wanted:#x})"
            )

    def _transfer(self, what: str, index: int, subindex: int, data: bytes | None) -> bytes:
        try:
            if data is None:
                return bytes(self._sdo.upload(index, subindex))
            self._sdo.download(index, subindex, data)
        except SdoAbortedError as error:
            raise _RefusedError(f"{self._name(index, subindex)}: {what} refused: {error}") from error
        except SdoCommunicationError as error:
            raise DeviceError(f"{self._name(index, subindex)}: {what}: no answer") from error
        except struct.error as error:
            raise DeviceError(f"{self._name(index, subindex)}: {what}: answer of wrong length") from error
        return b""

    def _variable(self, index: int, subindex: int) -> Any:
        variable = self.dictionary.get_variable(index, subindex)
        if variable is None and (index, subindex) in self._file.flaws:
            raise DeviceError(f"{self._eds}: {self._file.flaws[index, subindex]}, needed by {self.label}")
        if variable is None:
            raise DeviceError(f"{self._eds.name}: no object {index:04X}h:{subindex:02X}, needed by {self.label}")
        return variable

    def _name(self, index: int, subindex: int) -> str:
        return f"node {self.node_id} ({self.label}): object {index:04X}h:{subindex:02X}"


def find_eds(name: str, config_path: Path) -> Path:
    """The EDS beside the configuration that names it, else the one that comes with davpc.

    Raises:
        ConfigError: neither exists.
    """
    for folder in (config_path.parent, default_config_path().parent):
        if (folder / name).is_file():
            return folder / name
    raise ConfigError(f"{config_path}: EDS file {name!r} is not beside it")
