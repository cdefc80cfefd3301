"""What makes the Follower move, and what its drives and arms report."""

from __future__ import annotations

import struct
import zlib
from dataclasses import asdict
from typing import Annotated, ClassVar, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from common.messages.fields import STRICT, Angle, ArmCause, Count, Measured, Ns, Phase, Point2, Speed, Text, Torque


@dataclass(frozen=True, config=STRICT)
class Mission:
    """Orders of the supervisor to the Follower's processes; while ``armed``, it is the arm token.

    In the phase ``manual`` the operator's station commands the wheels: the arms stay where they are, the grippers
    follow ``grip`` and the lift goes to ``lift_m``.
    """

    SCHEMA: ClassVar[str] = "mission/3"
    phase: Phase
    cause: Text  # why the docking ended, see common.causes
    trolley: Annotated[int, Field(ge=1, le=99)]  # K: its place in the queue, 1 is the first
    epoch: Count  # of arming: commands of any other epoch are refused
    armed: bool
    motion: Literal["hold", "servo", "straight", "turn"]  # servo: to desired_features
    straight_speed_m_s: Speed  # for motion "straight"
    v_max_m_s: Annotated[float, Field(ge=0, le=1)]  # caps of this phase; they can only lower the configured limits
    w_max_rad_s: Annotated[float, Field(ge=0, le=2)]
    goal_theta_rad: Angle  # desired θ_L^F
    desired_features: Annotated[tuple[Point2, ...], Field(max_length=12)]  # x*: normalised [α, β] of each LED
    grip: Literal["open", "closed", "stay"]
    contact_expected: bool  # contact with guide or queue may begin now
    resets: Count  # acknowledgements of faults by the operator; the bridge acts on a change while disarmed
    waiting: Text = ""  # what the docking waits for while it goes on
    needs_reset: bool = False  # no docking begins before the operator resets
    turn_rate_rad_s: Annotated[float, Field(ge=-2, le=2)] = 0.0  # for motion "turn"
    lift_m: Annotated[float, Field(ge=0, le=2)] | None = None  # height in phase "manual"; None: stay


@dataclass(frozen=True, config=STRICT)
class Command:
    """A twist of {F} for the wheels. Make commands with :func:`seal_command`, which sets the checksum."""

    SCHEMA: ClassVar[str] = "command/1"
    v_m_s: Speed
    w_rad_s: Speed
    epoch: Count  # the mission's, for which it was made
    sequence: Count
    stamp_ns: Ns  # of publication: the command's age counts from here
    valid_until_ns: Ns
    frame_sequence: Count  # the image that it comes from, and when that was taken
    capture_ns: Ns
    checksum: Annotated[int, Field(ge=0, lt=2**32)] = 0  # CRC-32 over all other fields, end to end


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
    """Torques of joints and grippers, and the height of the lift."""

    SCHEMA: ClassVar[str] = "arm_setpoint/1"
    epoch: Count
    joint_torque_n_m: Annotated[tuple[Torque, ...], Field(min_length=6, max_length=6)]  # left 1-3, right 1-3
    grip_torque_n_m: tuple[Torque, Torque]  # left, right; positive closes
    lift_m: Annotated[float, Field(ge=0, le=2)]


@dataclass(frozen=True, config=STRICT)
class ArmState:
    """What the arms detect from the joint torques, and the state of the grippers."""

    SCHEMA: ClassVar[str] = "arm_state/2"
    handle_force_n: Annotated[float, Field(ge=-5000, le=5000)]  # push on the handle, along x of {F}
    contact: bool  # the trolley touches guide or queue
    connected: bool  # the connection is rigid
    gripped: bool  # both grippers hold the handle
    released: bool  # both grippers are open
    cause: ArmCause = "ok"  # since the epoch began: slip from a gripper, or a collision; the supervisor stops
    resistance_n: Annotated[float, Field(ge=-5000, le=5000)] = 0.0  # of the trolley before contact


@dataclass(frozen=True, config=STRICT)
class Drives:
    """What the drives measure, and what the gate passed on to them.

    In shadow and read-only operation the drives are never enabled: ``state`` and set-points are as if they were,
    measurements are real.
    """

    SCHEMA: ClassVar[str] = "drives/4"
    state: Literal["starting", "disarmed", "enabling", "armed", "stopped", "fault"]
    cause: Text  # of state "stopped" or "fault"
    epoch: Count
    measured_ns: Ns
    wheel_speed_rad_s: tuple[Measured, Measured]  # left, right
    wheel_angle_rad: tuple[Measured, Measured]
    joint_torque_n_m: Annotated[tuple[Torque, ...], Field(min_length=6, max_length=6)]  # left 1-3, right 1-3
    joint_angle_rad: Annotated[tuple[Measured, ...], Field(min_length=6, max_length=6)]
    grip_torque_n_m: tuple[Torque, Torque]
    grip_angle_rad: tuple[Measured, Measured]
    lift_m: Measured
    stop_inputs_clear: bool  # emergency stop and protective stop
    battery_v: Annotated[float, Field(ge=0, le=200)] | None  # None: what is read can be no battery's voltage
    v_set_m_s: Speed  # the twist last sent to the wheels
    w_set_rad_s: Speed
    command_sequence: Count  # last accepted command
    image_to_can_ns: Count  # from its image's capture to its first frame on the bus
    gate_interventions: Count  # how often the gate stopped, dropped or clipped something
    shadow: bool = False  # shadow or read-only operation
    gate_intervened: Text = ""  # rules of the last intervention
