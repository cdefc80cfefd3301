"""CANopen frames as plain values: COB-IDs, NMT, heartbeat, EMCY and its error codes (CiA 301, CiA 402)."""

from __future__ import annotations

import struct
from typing import NamedTuple

NMT = 0x000
SYNC = 0x080
EMCY = 0x080
TPDO = (0x180, 0x280, 0x380, 0x480)
RPDO = (0x200, 0x300, 0x400, 0x500)
SDO_RESPONSE = 0x580
SDO_REQUEST = 0x600
HEARTBEAT = 0x700

NMT_START = 0x01
NMT_STOP = 0x02
NMT_PRE_OPERATIONAL = 0x80
NMT_RESET_NODE = 0x81
NMT_RESET_COMMUNICATION = 0x82

STATE_BOOT_UP = 0x00
STATE_STOPPED = 0x04
STATE_OPERATIONAL = 0x05
STATE_PRE_OPERATIONAL = 0x7F

PDO_INVALID = 0x8000_0000
PDO_NO_RTR = 0x4000_0000
HEARTBEAT_LOST = 0x8130
ERROR_FLAG = 0x2000_0000
"""Marks an error report of the CAN controller, not a data frame (linux/can.h); the other bits are the error."""
EXTENDED_FLAG, REMOTE_FLAG = 0x8000_0000, 0x4000_0000
"""Mark a 29-bit identifier and a remote frame there; CANopen uses neither."""
BUS_OFF = 0x0000_0040

_EMCY = struct.Struct("<HB5s")
# CiA 301 table of emergency error codes and CiA 402's additions; the longest matching prefix names the fault.
_EMCY_NAMES: tuple[tuple[int, int, str], ...] = (
    (0x2310, 0xFFFF, "continuous over-current"),
    (0x2320, 0xFFF0, "short circuit or earth leakage"),
    (0x3210, 0xFFFF, "over-voltage of the DC link"),
    (0x3220, 0xFFFF, "under-voltage of the DC link"),
    (0x4210, 0xFFFF, "device too hot"),
    (0x4310, 0xFFFF, "drive too hot"),
    (0x7121, 0xFFFF, "motor blocked"),
    (0x7305, 0xFFFF, "incremental encoder fault"),
    (0x7310, 0xFFFF, "speed out of range"),
    (0x7320, 0xFFFF, "position sensor fault"),
    (0x8110, 0xFFFF, "CAN overrun"),
    (0x8120, 0xFFFF, "CAN error passive"),
    (0x8130, 0xFFFF, "heartbeat of the bridge lost"),
    (0x8140, 0xFFFF, "recovered from bus-off"),
    (0x8210, 0xFFFF, "PDO not processed: wrong length"),
    (0x8611, 0xFFFF, "following error"),
    (0x2000, 0xF000, "current"),
    (0x3000, 0xF000, "voltage"),
    (0x4000, 0xF000, "temperature"),
    (0x5000, 0xF000, "device hardware"),
    (0x6000, 0xF000, "device software"),
    (0x7000, 0xF000, "additional module"),
    (0x8000, 0xF000, "monitoring"),
    (0x9000, 0xF000, "external fault"),
    (0xF000, 0xF000, "device specific"),
)


class CanFrame(NamedTuple):
    """A classic CAN data frame with an 11-bit identifier; the length of ``data`` is its DLC."""

    can_id: int
    data: bytes


class Emergency(NamedTuple):
    """An EMCY object (CiA 301); error code 0: the node has no error any more."""

    code: int
    register: int
    vendor: bytes

    @property
    def name(self) -> str:
        """The fault in words, with its code."""
        for code, mask, text in _EMCY_NAMES:
            if self.code & mask == code:
                return f"{text} (EMCY {self.code:04X}h)"
        return f"generic fault (EMCY {self.code:04X}h)"


def nmt_frame(command: int, node_id: int = 0) -> CanFrame:
    """NMT command to one node, or to all with ``node_id`` 0."""
    return CanFrame(NMT, bytes((command, node_id)))


def heartbeat_frame(node_id: int, state: int) -> CanFrame:
    """Heartbeat, or boot-up with ``state`` 0."""
    return CanFrame(HEARTBEAT + node_id, bytes((state,)))


def emergency_frame(node_id: int, emergency: Emergency) -> CanFrame:
    """EMCY object of a node."""
    return CanFrame(EMCY + node_id, _EMCY.pack(*emergency))


def decode_emergency(data: bytes) -> Emergency | None:
    """The emergency of 8 bytes; None for any other length."""
    return Emergency(*_EMCY.unpack(data)) if len(data) == _EMCY.size else None


def consumer_heartbeat(node_id: int, time_ms: int) -> int:
    """Entry of object 1016h: node whose heartbeat is monitored, and its time-out [ms]."""
    return node_id << 16 | time_ms


def mapping(index: int, subindex: int, bits: int) -> int:
    """Entry of a PDO mapping object (1600h…, 1A00h…)."""
    return index << 16 | subindex << 8 | bits
