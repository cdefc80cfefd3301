"""Every message: a frozen dataclass with units in its field names and a schema version, as MessagePack on the wire.

On the wire a message is ``[schema, header, body, crc32]``. Decoding checks the schema and its version, every
type and range, that every number is finite, and the end-to-end checksum; whatever fails is a ``MessageError``.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import asdict
from functools import cache
from typing import Annotated, Any, ClassVar, Literal, Protocol, TypeVar, get_args

import msgpack
from pydantic import ConfigDict, Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

STRICT = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)

Count = Annotated[int, Field(ge=0, lt=2**63)]
Ns = Count
Angle = Annotated[float, Field(ge=-7.0, le=7.0)]
Metres = Annotated[float, Field(ge=-1000.0, le=1000.0)]
Speed = Annotated[float, Field(ge=-10.0, le=10.0)]
Torque = Annotated[float, Field(ge=-1000.0, le=1000.0)]
Text = Annotated[str, Field(max_length=400)]
Point2 = tuple[float, float]

Phase = Literal[
    "idle",
    "staging",
    "acquire",
    "search",
    "approach",
    "insert",
    "push",
    "lock",
    "release",
    "retract",
    "done",
    "aborted",
    "manual",
]
PHASES: tuple[Phase, ...] = get_args(Phase)
Method = Literal["paper", "davpc"]
StateCause = Literal[
    "ok",
    "no_frame",
    "stale_frame",
    "bad_frame",
    "frozen_camera",
    "overexposed",
    "underexposed",
    "noisy",
    "few_leds",
    "not_identified",
    "ambiguous",
    "confirming",
    "residual",
    "coasting",
    "behind_camera",
]
ArmCause = Literal["ok", "slip", "collision"]
GuideState = Literal["down", "lifted", "seated"]
LockState = Literal["open", "closing", "locked", "opening", "fault"]
Outcome = Literal["done", "accepted", "refused", "expired"]


class MessageError(ValueError):
    """Bytes that are not the message they should be; the text says what is wrong with them."""


class Message(Protocol):
    """What every message has: the name and version of its schema."""

    SCHEMA: ClassVar[str]


@dataclass(frozen=True, config=STRICT)
class Header:
    """Who published, when, and as which one of its messages.

    ``run_id`` changes with every start of the process; ``stamp_ns`` is CLOCK_MONOTONIC of boot ``boot_id``.
    """

    source: Annotated[str, Field(max_length=64)]
    run_id: Count
    sequence: Count
    stamp_ns: Ns
    boot_id: Annotated[str, Field(max_length=64)]


@dataclass(frozen=True, config=STRICT)
class Frame:
    """One 8-bit grey image: the note that says in which slot of the frame ring its pixels lie.

    ``capture_ns`` is the middle of the exposure. The pixels themselves never cross Zenoh (see
    :mod:`common.frame_ring`).
    """

    SCHEMA: ClassVar[str] = "frame/1"
    sequence: Annotated[int, Field(ge=1, lt=2**63)]
    slot: Count
    capture_ns: Ns
    camera_id: Text
    width_px: Annotated[int, Field(ge=1, le=8192)]
    height_px: Annotated[int, Field(ge=1, le=8192)]
    exposure_us: Annotated[float, Field(gt=0, le=1e6)]
    gain: Annotated[float, Field(gt=0, le=1000)]


@dataclass(frozen=True, config=STRICT)
class DockingState:
    """What the estimator knows of one frame.

    ``features`` are the measured normalised coordinates [α, β] of the LEDs, by LED, None for one not seen;
    ``features_filtered`` the same from the filtered pose. The pose is that of {L} in {F} at ``capture_ns``,
    its covariance row by row (x [m], y [m], θ [rad]). ``theta_homography_rad`` is θ_L^F of the paper's
    homography where that has a solution. ``disturbance`` is what the motion differs from the wheels by: relative
    speed, relative turn, yaw [rad/s], sideways [m/s]. ``fit`` is the frame's own planar fit, unfiltered: x [m],
    y [m], θ, camera pitch and roll [rad], with the covariance of x, y, θ in ``fit_covariance``. ``cause`` says
    what was wrong with the frame; ``valid`` outlives it for as long as the estimator carries the pose on.
    """

    SCHEMA: ClassVar[str] = "docking_state/1"
    frame_sequence: Count
    capture_ns: Ns
    valid: bool
    cause: StateCause
    leds_seen: Annotated[int, Field(ge=0, le=64)]
    features: Annotated[tuple[Point2 | None, ...], Field(max_length=12)]
    features_filtered: Annotated[tuple[Point2, ...], Field(max_length=12)]
    theta_homography_rad: Angle | None
    x_m: Metres
    y_m: Metres
    theta_rad: Angle
    covariance: Annotated[tuple[float, ...], Field(min_length=9, max_length=9)]
    disturbance: tuple[float, float, float, float]
    fit: tuple[Metres, Metres, Angle, Angle, Angle] | None
    fit_covariance: Annotated[tuple[float, ...], Field(min_length=9, max_length=9)] | None
    residual_px: Annotated[float, Field(ge=0)]
    spots: Count
    frames_seen: Count
    frames_dropped: Count


@dataclass(frozen=True, config=STRICT)
class Mission:
    """What the supervisor wants of the Follower's processes; while ``armed`` it is the arm token.

    ``motion`` tells the controller: ``servo`` to the desired features, ``straight`` at ``straight_speed_m_s``,
    ``turn`` in place at ``turn_rate_rad_s``, or ``hold``. The caps may only lower the configured limits. ``resets``
    counts a person's requests to acknowledge faults; the bridge acts on a change while it is disarmed. ``cause`` is
    why the docking ended (see :mod:`common.causes`), ``waiting`` what it waits for while it goes on;
    ``needs_reset``: nothing begins before a person has reset it. In phase ``manual`` a
    person's station commands the wheels: the arms stay where they are, the fingers do as ``grip`` says and the lift
    goes to ``lift_m``, if any.
    """

    SCHEMA: ClassVar[str] = "mission/2"
    phase: Phase
    cause: Text
    trolley: Annotated[int, Field(ge=1, le=99)]
    method: Method
    epoch: Count
    armed: bool
    motion: Literal["hold", "servo", "straight", "turn"]
    straight_speed_m_s: Speed
    v_max_m_s: Annotated[float, Field(ge=0, le=1)]
    w_max_rad_s: Annotated[float, Field(ge=0, le=2)]
    goal_theta_rad: Angle
    desired_features: Annotated[tuple[Point2, ...], Field(max_length=12)]
    grip: Literal["open", "closed", "stay"]
    push: bool
    resets: Count
    waiting: Text = ""
    needs_reset: bool = False
    turn_rate_rad_s: Annotated[float, Field(ge=-2, le=2)] = 0.0
    lift_m: Annotated[float, Field(ge=0, le=2)] | None = None


@dataclass(frozen=True, config=STRICT)
class Command:
    """A twist of {F} for the wheels.

    Its age counts from ``stamp_ns``; ``capture_ns`` and ``frame_sequence`` name the image it came from.
    ``checksum`` covers every other field end to end: make commands with :func:`seal_command`.
    """

    SCHEMA: ClassVar[str] = "command/1"
    v_m_s: Speed
    w_rad_s: Speed
    epoch: Count
    sequence: Count
    stamp_ns: Ns
    valid_until_ns: Ns
    frame_sequence: Count
    capture_ns: Ns
    checksum: Annotated[int, Field(ge=0, lt=2**32)] = 0


def command_checksum(command: Command) -> int:
    """CRC-32 over every field but the checksum itself."""
    packed = struct.pack(
        "<2d6Q",
        command.v_m_s,
        command.w_rad_s,
        command.epoch,
        command.sequence,
        command.stamp_ns,
        command.valid_until_ns,
        command.frame_sequence,
        command.capture_ns,
    )
    return zlib.crc32(packed)


def seal_command(command: Command) -> Command:
    """The same command with its checksum."""
    return Command(**{**asdict(command), "checksum": command_checksum(command)})


@dataclass(frozen=True, config=STRICT)
class ArmSetpoint:
    """Torques of the six joints (left 1–3, right 1–3) and two grippers, and the lift's height."""

    SCHEMA: ClassVar[str] = "arm_setpoint/1"
    epoch: Count
    joint_torque_n_m: Annotated[tuple[Torque, ...], Field(min_length=6, max_length=6)]
    grip_torque_n_m: tuple[Torque, Torque]
    lift_m: Annotated[float, Field(ge=0, le=2)]


@dataclass(frozen=True, config=STRICT)
class ArmState:
    """What the arms feel: force along the handle, contact ahead, a rigid connection, what the grippers hold.

    ``cause`` is what happened since the epoch began, for the supervisor to stop by: the trolley slipped from a
    gripper, or a torque spiked. ``resistance_n`` is what the trolley resisted with before there was contact.
    """

    SCHEMA: ClassVar[str] = "arm_state/2"
    handle_force_n: Annotated[float, Field(ge=-5000, le=5000)]
    contact: bool
    connected: bool
    gripped: bool
    released: bool
    cause: ArmCause = "ok"
    resistance_n: Annotated[float, Field(ge=-5000, le=5000)] = 0.0


@dataclass(frozen=True, config=STRICT)
class Drives:
    """What the bus says, and what the gate let through to it.

    ``v_set``/``w_set`` are what was last sent; ``command_sequence`` is the last command that was accepted and
    ``image_to_can_ns`` the time from its image's capture to its first frame on the bus. ``gate_intervened`` names the
    rules that the last of ``gate_interventions`` was for. In ``shadow`` (and read-only) the drives
    are never enabled: ``state`` and what is set are as if they were, what is measured is measured.
    """

    SCHEMA: ClassVar[str] = "drives/2"
    state: Literal["starting", "disarmed", "enabling", "armed", "stopped", "fault"]
    cause: Text
    epoch: Count
    measured_ns: Ns
    wheel_speed_rad_s: tuple[float, float]
    wheel_angle_rad: tuple[float, float]
    joint_torque_n_m: Annotated[tuple[Torque, ...], Field(min_length=6, max_length=6)]
    joint_angle_rad: Annotated[tuple[float, ...], Field(min_length=6, max_length=6)]
    grip_torque_n_m: tuple[Torque, Torque]
    grip_angle_rad: tuple[float, float]
    lift_m: float
    stop_inputs_clear: bool
    battery_v: Annotated[float, Field(ge=0, le=200)]
    v_set_m_s: Speed
    w_set_rad_s: Speed
    command_sequence: Count
    image_to_can_ns: Count
    gate_rule: Text
    gate_interventions: Count
    shadow: bool = False
    gate_intervened: Text = ""


@dataclass(frozen=True, config=STRICT)
class FollowerSummary:
    """What others may know of the Follower: it leaves the robot, for the Leader's interlock and for people.

    ``moving``: its wheels turn, or may be told to; ``in_contact``: it pushes against guide or queue, or holds a
    trolley there that is not known to be locked; so it is taken after a start with closed grippers, until known.
    """

    SCHEMA: ClassVar[str] = "follower_summary/1"
    phase: Phase
    cause: Text
    waiting: Text
    trolley: Annotated[int, Field(ge=1, le=99)]
    armed: bool
    moving: bool
    in_contact: bool
    gripped: bool
    needs_reset: bool


@dataclass(frozen=True, config=STRICT)
class LeaderState:
    """LED array, guide, lock and queue of the Leader; its publication is the Leader's heartbeat.

    ``queue`` is how many trolleys are locked, None where the Leader does not know: a person has to say.
    ``led_setpoint_a`` is what the LEDs are told, less than asked for while ``led_derated``.
    """

    SCHEMA: ClassVar[str] = "leader_state/2"
    ready: bool
    cause: Text
    led_current_a: Annotated[tuple[float, ...], Field(max_length=12)]
    led_fault: bool
    guide: GuideState
    lock: LockState
    actuator_current_a: Annotated[float, Field(ge=0, le=100)]
    queue: Count | None
    led_setpoint_a: Annotated[tuple[float, ...], Field(max_length=12)] = ()
    led_derated: bool = False


@dataclass(frozen=True, config=STRICT)
class GatewayState:
    """A robot's gateway: whether it hears the other robot's, and for how long its certificate is still good.

    ``rules`` is the digest of the access rules that it works by: see :func:`gateway.access.rules_digest`.
    """

    SCHEMA: ClassVar[str] = "gateway_state/2"
    linked: bool
    certificate_left_s: float
    rules: Annotated[str, Field(max_length=64)]


@dataclass(frozen=True, config=STRICT)
class Health:
    """How a process is doing: published by every process about itself."""

    SCHEMA: ClassVar[str] = "health/1"
    process: Text
    ready: bool
    steps: Count
    missed_periods: Count
    malformed: Count
    step_p99_ms: Annotated[float, Field(ge=0)]


@dataclass(frozen=True, config=STRICT)
class DockRequest:
    """A person or a program asks the supervisor; not carried out after ``expires_ns``, nor twice for one id."""

    SCHEMA: ClassVar[str] = "dock_request/1"
    id: Text
    expires_ns: Ns
    action: Literal["start", "abort", "reset"]
    trolley: Annotated[int, Field(ge=1, le=99)] = 1


@dataclass(frozen=True, config=STRICT)
class ManualRequest:
    """A person wants to move the robot by hand: ``start`` arms the phase ``manual``, ``stop`` ends it.

    It lasts only while commands of its epoch keep coming from whoever asked. ``lift_m`` None leaves the lift.
    """

    SCHEMA: ClassVar[str] = "manual_request/1"
    id: Text
    expires_ns: Ns
    action: Literal["start", "stop"]
    grip: Literal["open", "closed", "stay"] = "stay"
    lift_m: Annotated[float, Field(ge=0, le=1)] | None = None


@dataclass(frozen=True, config=STRICT)
class LockRequest:
    """The supervisor or a person asks the Leader.

    ``valid_for_ms`` counts from receipt: clocks of two robots never meet.
    ``lock`` closes behind trolley 1, ``confirm`` asks whether the lock still holds now that ``trolley`` stands in the
    queue, ``unlock`` lets a queue go and must be ``confirmed`` by a person, ``reset`` clears a lock fault, ``count``
    says that ``trolley`` trolleys stand in the queue (0: none).
    """

    SCHEMA: ClassVar[str] = "lock_request/2"
    id: Text
    valid_for_ms: Annotated[int, Field(ge=1, le=60_000)]
    action: Literal["lock", "confirm", "unlock", "reset", "count"]
    trolley: Annotated[int, Field(ge=0, le=99)] = 1
    confirmed: bool = False


@dataclass(frozen=True, config=STRICT)
class LedRequest:
    """A person sets the current of one LED, or of all; 0 is off, None the configured current."""

    SCHEMA: ClassVar[str] = "led_request/1"
    id: Text
    valid_for_ms: Annotated[int, Field(ge=1, le=60_000)]
    led: Annotated[int, Field(ge=0, lt=12)] | None
    current_a: Annotated[float, Field(ge=0, le=5)] | None


@dataclass(frozen=True, config=STRICT)
class Answer:
    """What became of the request with this id."""

    SCHEMA: ClassVar[str] = "answer/1"
    id: Text
    outcome: Outcome
    reason: Text


M = TypeVar("M", bound=Message)
_MAX_BYTES = 65_536
_PAIR, _QUADRUPLE = b"\x92", b"\x94"  # MessagePack's heads of an array of two and of four


@cache
def _adapter(message_type: type[Any]) -> TypeAdapter[Any]:
    return TypeAdapter(message_type)


def encode(message: Message, header: Header) -> bytes:
    """MessagePack bytes of a message and its header."""
    fields = _adapter(Header).dump_python(header)
    body = _adapter(type(message)).dump_python(message)
    content: bytes = msgpack.packb(fields) + msgpack.packb(body)
    checksum = zlib.crc32(_PAIR + content)
    packed: bytes = _QUADRUPLE + msgpack.packb(message.SCHEMA) + content + msgpack.packb(checksum)
    return packed


def decode(message_type: type[M], payload: bytes) -> tuple[Header, M]:
    """Header and message of MessagePack bytes.

    Raises:
        MessageError: other schema or version, wrong type, missing or unknown field, out of range, not finite,
            or a checksum that does not fit.
    """
    if len(payload) > _MAX_BYTES:
        raise MessageError(f"{len(payload)} bytes are more than any message has")
    try:
        unpacked = msgpack.unpackb(payload, use_list=False)
    except (ValueError, RecursionError, msgpack.UnpackException) as error:
        raise MessageError(f"not MessagePack: {type(error).__name__}") from error
    if not isinstance(unpacked, tuple) or len(unpacked) != 4:
        raise MessageError("not [schema, header, body, checksum]")
    schema, fields, body, checksum = unpacked
    if schema != message_type.SCHEMA:
        raise MessageError(f"schema {schema!r}, expected {message_type.SCHEMA!r}")
    try:
        header, message = Header(**fields), message_type(**body)
    except TypeError as error:
        raise MessageError(f"{schema}: header or body is not a table") from error
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        raise MessageError(f"{schema}: {'.'.join(map(str, first['loc']))}: {first['msg']}") from error
    if checksum != _crc(body, fields):
        raise MessageError(f"{schema}: checksum does not fit")
    return header, message


def _crc(body: dict[str, Any], header: dict[str, Any]) -> int:
    """CRC-32 of header and body in their packed form."""
    return zlib.crc32(msgpack.packb([header, body]))
