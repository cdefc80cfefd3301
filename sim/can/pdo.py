"""PDOs of a simulated device: their communication and mapping parameters (CiA 301), and the layouts that follow."""

from __future__ import annotations

import struct
from collections.abc import Callable
from contextlib import suppress
from typing import Any, NamedTuple

from canopen.objectdictionary import SIGNED_TYPES
from canopen.sdo.exceptions import SdoAbortedError

from common.canopen.frames import PDO_INVALID, PDO_NO_RTR, RPDO, TPDO

Key = tuple[int, int]
"""Index and sub-index of an object."""
_FIRST_TPDO = 0x1800
_SLOWEST_SYNCHRONOUS, _EVENT_DRIVEN = 240, 254
_ABORT_READ_ONLY_NOW = 0x08000022
_ABORT_VALUE_RANGE = 0x06090030
_ABORT_NOT_MAPPABLE = 0x06040041
_ABORT_TOO_LONG = 0x06040042
_FORMATS = {(8, False): "B", (8, True): "b", (16, False): "H", (16, True): "h", (32, False): "I", (32, True): "i"}


class Pdo(NamedTuple):
    """A valid PDO: how its bytes are laid out, and which objects they are."""

    codec: struct.Struct
    keys: tuple[Key, ...]


class PdoTable:
    """The PDOs that are valid, by COB-ID. ``values`` is the device's dictionary, ``variable`` describes an object."""

    def __init__(self, node_id: int, values: dict[Key, int], variable: Callable[[int, int], Any]) -> None:
        self._node_id = node_id
        self._values = values
        self._variable = variable
        self.receive: dict[int, Pdo] = {}
        self.transmit: dict[int, Pdo] = {}
        self._no_rtr = [False] * len(TPDO)

    def load(self) -> None:
        """Take over the PDOs as the dictionary has them after switching on; a mapping that cannot be is none."""
        self.receive.clear()
        self.transmit.clear()
        for first, base, table in ((0x1400, RPDO, self.receive), (0x1800, TPDO, self.transmit)):
            for number, start in enumerate(base):
                cob_id = self._values[first + number, 1]
                if first == _FIRST_TPDO:
                    self._no_rtr[number] = bool(cob_id & PDO_NO_RTR)
                if cob_id & ~PDO_NO_RTR == start + self._node_id:
                    with suppress(SdoAbortedError):
                        table[start + self._node_id] = self._mapped(first + 0x200 + number)

    def configure(self, index: int, subindex: int, value: int) -> None:
        """A write to 1400h … 1BFFh, before it is stored.

        Raises:
            SdoAbortedError: CiA 301: a mapping changes only while its PDO is invalid; enabling it checks the mapping.
        """
        transmit, number = index >= _FIRST_TPDO, index & 0x1FF
        if number >= len(TPDO):
            return
        parameters = 0x1800 + number if transmit else 0x1400 + number
        valid = not self._values[parameters, 1] & PDO_INVALID
        table = self.transmit if transmit else self.receive
        cob_id = (TPDO if transmit else RPDO)[number] + self._node_id
        if index != parameters:
            if valid or (subindex == 0 and value > 4):
                raise SdoAbortedError(_ABORT_READ_ONLY_NOW)
        elif subindex == 1:
            if value & 0x7FF != cob_id or (transmit and self._no_rtr[number] and not value & PDO_NO_RTR):
                raise SdoAbortedError(_ABORT_VALUE_RANGE)
            if value & PDO_INVALID:
                table.pop(cob_id, None)
            else:
                table[cob_id] = self._mapped(parameters + 0x200)
        elif subindex == 2 and _SLOWEST_SYNCHRONOUS < value < _EVENT_DRIVEN:
            raise SdoAbortedError(_ABORT_VALUE_RANGE)

    def _mapped(self, index: int) -> Pdo:
        keys: list[Key] = []
        layout = "<"
        for position in range(1, self._values[index, 0] + 1):
            entry = self._values[index, position]
            key = (entry >> 16, entry >> 8 & 0xFF)
            variable = self._variable(*key)
            bits = entry & 0xFF
            form = _FORMATS.get((bits, variable.data_type in SIGNED_TYPES))
            if not variable.pdo_mappable or bits != len(variable) or form is None:
                raise SdoAbortedError(_ABORT_NOT_MAPPABLE)
            layout += form
            keys.append(key)
        codec = struct.Struct(layout)
        if codec.size > 8:
            raise SdoAbortedError(_ABORT_TOO_LONG)
        return Pdo(codec, tuple(keys))
