"""What makes the Follower move, and what its drives and arms say."""

from __future__ import annotations

import struct
import zlib
from dataclasses import asdict
from typing import Annotated, ClassVar, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from common.messages.fields import STRICT, Angle, ArmCause, Count, Ns, Phase, Point2, Speed, Text, Torque


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

    SCHEMA: ClassVar[str] = "mission/3"
    phase: Phase
    cause: Text
    trolley: Annotated[int, Field(ge=1, le=99)]
    epoch: Count
    armed: bool
    motion: Literal["hold", "servo", "straight", "turn"]
    straight_speed_m_s: Speed
    v_max_m_s: Annotated[float, Field(ge=0, le=1)]
    w_max_rad_s: Annotated[float, Field(ge=0, le=2)]
    goal_theta_rad: Angle
    desired_features: Annotated[tuple[Point2, ...], Field(max_length=12)]
    grip: Literal["open", "closed", "stay"]
    contact_expected: bool
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

    SCHEMA: ClassVar[str] = "drives/3"
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
    gate_interventions: Count
    shadow: bool = False
    gate_intervened: Text = ""
