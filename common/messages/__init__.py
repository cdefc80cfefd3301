"""Every message: a frozen dataclass with units in its field names and a schema version, as MessagePack on the wire.

On the wire a message is ``[schema, header, body, crc32]``. Decoding checks the schema and its version, every
type and range, that every number is finite, and the end-to-end checksum; a failure is a ``MessageError``.
"""

from common.messages.fields import (
    PHASES,
    STRICT,
    Angle,
    ArmCause,
    Count,
    GuideState,
    LockState,
    Metres,
    Ns,
    Outcome,
    Phase,
    Point2,
    RequestId,
    Speed,
    StateCause,
    Text,
    Torque,
)
from common.messages.motion import ArmSetpoint, ArmState, Command, Drives, Mission, command_checksum, seal_command
from common.messages.perception import DockingState, Frame
from common.messages.records import NodeSnapshot, StepJournal
from common.messages.requests import Answer, DockRequest, LedRequest, LockRequest, ManualRequest
from common.messages.summaries import FollowerSummary, GatewayState, Health, LeaderState
from common.messages.wire import Header, M, Message, MessageError, decode, encode

__all__ = [
    "PHASES",
    "STRICT",
    "Angle",
    "Answer",
    "ArmCause",
    "ArmSetpoint",
    "ArmState",
    "Command",
    "Count",
    "DockRequest",
    "DockingState",
    "Drives",
    "FollowerSummary",
    "Frame",
    "GatewayState",
    "GuideState",
    "Header",
    "Health",
    "LeaderState",
    "LedRequest",
    "LockRequest",
    "LockState",
    "M",
    "ManualRequest",
    "Message",
    "MessageError",
    "Metres",
    "Mission",
    "NodeSnapshot",
    "Ns",
    "Outcome",
    "Phase",
    "Point2",
    "RequestId",
    "Speed",
    "StateCause",
    "StepJournal",
    "Text",
    "Torque",
    "command_checksum",
    "decode",
    "encode",
    "seal_command",
]
