"""Configures CANopen nodes by SDO, each write read back, through single-threaded access to the bus."""

from __future__ import annotations

import queue
import struct
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import canopen
from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError

from common.canopen.bus import CanBus
from common.canopen.frames import (
    PDO_INVALID,
    RPDO,
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

MappedObject = tuple[int, int, int]
"""Index, sub-index and length in bits of an object in a PDO."""


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
        self.dictionary = load_dictionary(eds, node_id)
        self._eds = eds
        node = canopen.RemoteNode(node_id, self.dictionary)
        _SingleThreadedNetwork(bus).add_node(node)
        node.sdo.RESPONSE_TIMEOUT = SDO_TIMEOUT_S
        node.sdo.responses = _PumpedAnswers(bus, SDO_RESPONSE + node_id)
        self._sdo = node.sdo

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

    def write(self, index: int, subindex: int, value: int) -> None:
        """Write a number and read it back.

        Raises:
            DeviceError: no answer, refused, not in the EDS, or the node keeps another value.
        """
        variable = self._variable(index, subindex)
        try:
            raw = variable.encode_raw(value)
        except (struct.error, ValueError) as error:
            raise DeviceError(f"{self._name(index, subindex)}: {value} does not fit its type") from error
        self._transfer(f"write of {value}", index, subindex, raw)
        kept = self.read(index, subindex)
        if kept != value:
            raise DeviceError(f"{self._name(index, subindex)}: wrote {value}, the node keeps {kept}")

    def check_identity(self, serial: int = 0) -> None:
        """Compare 1000h and 1018h with the EDS, and the serial number unless ``serial`` is 0.

        Raises:
            DeviceError: another device; the text names the object that differs.
        """
        information = self.dictionary.device_information
        self.expect(0x1000, 0, self._variable(0x1000, 0).default, "device type")
        self.expect(0x1018, 1, information.vendor_number, "vendor")
        self.expect(0x1018, 2, information.product_number, "product")
        if serial:
            self.expect(0x1018, 4, serial, "serial number")

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
        """CiA 301: disable the PDO, empty its mapping, fill it, enable it."""
        parameter, table = parameters + number - 1, mappings + number - 1
        cob_id = base[number - 1] + self.node_id
        self.write(parameter, 1, PDO_INVALID | cob_id)
        self.write(table, 0, 0)
        for subindex, entry in enumerate(objects, start=1):
            self.write(table, subindex, mapping(*entry))
        self.write(table, 0, len(objects))
        self.write(parameter, 2, SYNCHRONOUS)
        self.write(parameter, 1, cob_id)

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
            raise DeviceError(f"{self._name(index, subindex)}: {what} refused: {error}") from error
        except SdoCommunicationError as error:
            raise DeviceError(f"{self._name(index, subindex)}: {what}: no answer") from error
        except struct.error as error:
            raise DeviceError(f"{self._name(index, subindex)}: {what}: answer of wrong length") from error
        return b""

    def _variable(self, index: int, subindex: int) -> Any:
        variable = self.dictionary.get_variable(index, subindex)
        if variable is None:
            raise DeviceError(f"{self._eds.name}: no object {index:04X}h:{subindex:02X}, needed by {self.label}")
        return variable

    def _name(self, index: int, subindex: int) -> str:
        return f"node {self.node_id} ({self.label}): object {index:04X}h:{subindex:02X}"


@lru_cache(maxsize=64)
def load_dictionary(eds: Path, node_id: int) -> Any:
    """Object dictionary of an EDS for one node id, a ``canopen.ObjectDictionary``; do not change it.

    Raises:
        ConfigError: missing or not an EDS.
    """
    try:
        dictionary = canopen.import_od(str(eds), node_id)
    except OSError as error:
        raise ConfigError(f"{eds}: cannot be read: {error.strerror}") from error
    except Exception as error:  # the parser raises many kinds of errors
        first_line = str(error).partition("\n")[0]
        raise ConfigError(f"{eds}: not an EDS: {first_line}") from error
    if not dictionary.names:
        raise ConfigError(f"{eds}: not an EDS: it describes no object")
    return dictionary


def find_eds(name: str, config_path: Path) -> Path:
    """The EDS beside the configuration that names it, else the one that comes with davpc.

    Raises:
        ConfigError: neither exists.
    """
    for folder in (config_path.parent, default_config_path().parent):
        if (folder / name).is_file():
            return folder / name
    raise ConfigError(f"{config_path}: EDS file {name!r} is not beside it")
