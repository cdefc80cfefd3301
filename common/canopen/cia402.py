"""The drive profile's state machine and modes, from the master's side (CiA 402 = IEC 61800-7-201)."""

from __future__ import annotations

from enum import Enum, IntEnum


class DriveState(Enum):
    """Power drive system states; the value is the name in messages to the operator."""

    NOT_READY = "not ready to switch on"
    SWITCH_ON_DISABLED = "switch on disabled"
    READY = "ready to switch on"
    SWITCHED_ON = "switched on"
    ENABLED = "operation enabled"
    QUICK_STOP = "quick stop active"
    FAULT_REACTION = "fault reaction active"
    FAULT = "fault"
    UNKNOWN = "unknown"


class Mode(IntEnum):
    """Modes of operation (6060h) that davpc uses."""

    PROFILE_POSITION = 1
    PROFILE_VELOCITY = 3
    PROFILE_TORQUE = 4
    HOMING = 6


class Target(Enum):
    """State that the master wants."""

    DISABLED = "disabled"
    ENABLED = "enabled"
    QUICK_STOP = "quick stop"


DISABLE_VOLTAGE = 0x0000
QUICK_STOP = 0x0002
SHUTDOWN = 0x0006
SWITCH_ON = 0x0007
ENABLE_OPERATION = 0x000F
FAULT_RESET = 0x0080
NEW_SETPOINT = 0x0010
CHANGE_AT_ONCE = 0x0020
START_HOMING = 0x0010

STATUS_SETPOINT_ACKNOWLEDGE = 0x1000
STATUS_TARGET_REACHED = 0x0400
STATUS_HOMING_ATTAINED = 0x1000
STATUS_HOMING_ERROR = 0x2000

# statusword & mask == value: CiA 402, table "state coding"; the first four need bit 5 only where it is in the mask
_CODING: tuple[tuple[int, int, DriveState], ...] = (
    (0x4F, 0x00, DriveState.NOT_READY),
    (0x4F, 0x40, DriveState.SWITCH_ON_DISABLED),
    (0x6F, 0x21, DriveState.READY),
    (0x6F, 0x23, DriveState.SWITCHED_ON),
    (0x6F, 0x27, DriveState.ENABLED),
    (0x6F, 0x07, DriveState.QUICK_STOP),
    (0x4F, 0x0F, DriveState.FAULT_REACTION),
    (0x4F, 0x08, DriveState.FAULT),
)


def _decode(statusword: int) -> DriveState:
    for mask, value, state in _CODING:
        if statusword & mask == value:
            return state
    return DriveState.UNKNOWN


_STATES = tuple(_decode(word) for word in range(0x80))


def decode_statusword(statusword: int) -> DriveState:
    """State of a statusword (6041h); UNKNOWN for a coding outside the standard."""
    return _STATES[statusword & 0x7F]


_UP = {
    DriveState.SWITCH_ON_DISABLED: SHUTDOWN,
    DriveState.READY: SWITCH_ON,
    DriveState.SWITCHED_ON: ENABLE_OPERATION,
    DriveState.ENABLED: ENABLE_OPERATION,
}
_DOWN = {
    DriveState.ENABLED: SWITCH_ON,
    DriveState.SWITCHED_ON: SHUTDOWN,
}


def controlword(state: DriveState, target: Target, holds_in_quick_stop: bool) -> int:
    """The controlword that takes a drive one transition closer to ``target``.

    Args:
        state: from its statusword.
        target: state to reach.
        holds_in_quick_stop: the drive stays powered in quick stop (605Ah = 6) and can be enabled from there;
            otherwise (605Ah = 2) it leaves quick stop by itself at standstill, and is left alone until then.
    """
    if state is DriveState.QUICK_STOP:
        if not holds_in_quick_stop or target is Target.QUICK_STOP:
            return QUICK_STOP
        return ENABLE_OPERATION if target is Target.ENABLED else DISABLE_VOLTAGE
    if target is Target.ENABLED:
        return _UP.get(state, DISABLE_VOLTAGE)
    if target is Target.QUICK_STOP:
        # an unknown state is treated as moving: quick stop never adds motion
        return QUICK_STOP if state in (DriveState.ENABLED, DriveState.UNKNOWN) else DISABLE_VOLTAGE
    return _DOWN.get(state, DISABLE_VOLTAGE)
