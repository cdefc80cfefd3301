"""Object dictionary of a simulated device, from the EDS of any maker: values after switching on, limits."""

from __future__ import annotations

from typing import Any

import canopen
from canopen.objectdictionary import NUMBER_TYPES
from canopen.sdo.exceptions import SdoAbortedError

from common.canopen.eds import initial_value
from sim.can.pdo import Key

_COMMUNICATION = range(0x1000, 0x2000)
_ABORT_VALUE_HIGH = 0x06090031
_ABORT_VALUE_LOW = 0x06090032


class ObjectValues(dict[Key, int]):
    """Values by object; one that the EDS lacks is 0 inside the device, and no client gets at it."""

    def __missing__(self, key: Key) -> int:
        return 0


def initial_values(dictionary: Any) -> tuple[dict[Key, int], dict[Key, bytes]]:
    """Numbers and texts after switching on, of a ``canopen.ObjectDictionary``."""
    numbers, texts = dict[Key, int](), dict[Key, bytes]()
    for index in dictionary:
        entry = dictionary[index]
        for part in [entry] if isinstance(entry, canopen.objectdictionary.ODVariable) else entry.values():
            if part.data_type in NUMBER_TYPES:
                numbers[part.index, part.subindex] = initial_value(part) or 0
            else:
                texts[part.index, part.subindex] = str(part.default).encode()
    return numbers, texts


def check_limits(variable: Any, value: int) -> None:
    """Refuse a value outside the limits of the EDS; those of communication objects are often wrong, and do not bind.

    Raises:
        SdoAbortedError: too high, or too low.
    """
    if variable.index in _COMMUNICATION:
        return
    if variable.max is not None and value > variable.max:
        raise SdoAbortedError(_ABORT_VALUE_HIGH)
    if variable.min is not None and value < variable.min:
        raise SdoAbortedError(_ABORT_VALUE_LOW)
