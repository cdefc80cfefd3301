"""Both CAN buses and their nodes."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Literal

from pydantic import Field, model_validator

from common.ceilings import HARD_LIFT_M
from common.config.section import Positive, Section

BATTERY_V_PER_COUNT = 0.01
"""Scale of analogue input 1 of the Follower's I/O module: battery voltage."""


class HomingConfig(Section):
    """Homing of an axis with an incremental encoder (CiA 402 mode 6). Units: rad, or m for the lift."""

    method: Annotated[int, Field(ge=-128, le=127, description="homing method, 6098h, in the motor's direction")]
    position: Annotated[float, Field(description="position of the axis at its home")]
    search_speed: Annotated[float, Field(gt=0, le=0.5, description="speed towards the switch, per second, 6099h:01")]
    zero_speed: Annotated[float, Field(gt=0, le=0.5, description="speed away from the switch, per second, 6099h:02")]
    acceleration: Annotated[float, Field(gt=0, le=5.0, description="per second squared, 609Ah")]
    timeout_s: Annotated[float, Field(gt=0, le=120)] = 30.0


class DriveConfig(Section):
    """One CiA 402 drive on the bus."""

    node_id: Annotated[int, Field(ge=1, le=127)]
    counts_per_turn: Annotated[int, Field(ge=4, le=2**28)] = 65536
    gear_ratio: Annotated[float, Field(ge=0.1, le=1000.0)] = 1.0
    sign: Literal[1, -1] = 1
    zero_counts: Annotated[
        int, Field(ge=-(2**31), lt=2**31, description="absolute encoder at the zero of the axis")
    ] = 0
    rated_torque_n_m: Annotated[Positive, Field(description="of the motor, before the gear, 6076h")] = 0.5
    max_torque_permille: Annotated[int, Field(ge=0, le=3000, description="limit, of the rated torque, 6072h")] = 1000
    serial: Annotated[int, Field(ge=0, lt=2**32, description="serial number, 1018h:04; 0 accepts any")] = 0
    homing: Annotated[HomingConfig | None, Field(description="without it the encoder is absolute")] = None

    @model_validator(mode="after")
    def _one_zero(self) -> DriveConfig:
        if self.homing is not None and self.zero_counts:
            raise ValueError("zero_counts belongs to an absolute encoder: with homing, homing.position sets the zero")
        return self


class BusConfig(Section):
    """One CAN bus, in the terms of python-can."""

    interface: Literal["socketcan", "socketcand", "stepped"]
    channel: str
    host: str = ""
    port: Annotated[int, Field(ge=0, le=65535)] = 0
    bitrate: Annotated[int, Field(ge=10_000, le=1_000_000)] = 1_000_000


class FollowerCanConfig(Section):
    """The Follower's bus and its nodes. EDS files lie beside the configuration."""

    bus: BusConfig
    master_node_id: Annotated[int, Field(ge=1, le=127)] = 127
    drive_eds: str
    io_eds: str
    left_wheel: DriveConfig
    right_wheel: DriveConfig
    joints: Annotated[tuple[DriveConfig, ...], Field(min_length=6, max_length=6)]
    grippers: Annotated[tuple[DriveConfig, ...], Field(min_length=2, max_length=2)]
    lift: DriveConfig
    io_node_id: Annotated[int, Field(ge=1, le=127)]
    shadow: Annotated[bool, Field(description="never enable a drive; report what would be commanded")] = False
    readonly: Annotated[bool, Field(description="send nothing; report what another master does on the bus")] = False
    watchdog_ms: Annotated[int, Field(ge=20, le=80)]
    wheel_ramp_m_s2: Annotated[float, Field(gt=0, le=1.0, description="ramps of the drives, 6083h to 6085h")]
    lift_lead_m: Annotated[Positive, Field(description="lift per turn of the lead screw")]
    lift_max_m: Annotated[
        float, Field(gt=0, le=HARD_LIFT_M, description="travel of the lift: it is never commanded beyond it")
    ] = HARD_LIFT_M
    lift_speed_m_s: Annotated[float, Field(gt=0, le=0.1)]
    lift_acceleration_m_s2: Annotated[float, Field(gt=0, le=1.0)]

    @cached_property
    def drives(self) -> tuple[DriveConfig, ...]:
        """All eleven, in the order wheels, joints, grippers, lift."""
        return (self.left_wheel, self.right_wheel, *self.joints, *self.grippers, self.lift)

    @model_validator(mode="after")
    def _only_arms_are_homed(self) -> FollowerCanConfig:
        if any(drive.homing is not None for drive in (self.left_wheel, self.right_wheel, *self.grippers)):
            raise ValueError("homing is for joints and lift; wheels and grippers have none")
        return self

    @model_validator(mode="after")
    def _ids_differ(self) -> FollowerCanConfig:
        ids = [drive.node_id for drive in self.drives] + [self.io_node_id, self.master_node_id]
        twice = sorted({i for i in ids if ids.count(i) > 1})
        if twice:
            raise ValueError(f"node id {twice[0]} is given twice")
        return self


class LeaderCanConfig(Section):
    """The Leader's bus and its I/O module.

    When the Leader is silent for ``watchdog_ms`` the actuator stops where it is; the LEDs stay as they are.
    """

    bus: BusConfig
    master_node_id: Annotated[int, Field(ge=1, le=127)] = 127
    io_node_id: Annotated[int, Field(ge=1, le=127)]
    io_eds: str
    watchdog_ms: Annotated[int, Field(ge=60, le=1000)]
