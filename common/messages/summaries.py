"""State of a robot, a gateway or a process."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field
from pydantic.dataclasses import dataclass

from common.messages.fields import STRICT, Count, GuideState, LockState, Phase, Text


@dataclass(frozen=True, config=STRICT)
class FollowerSummary:
    """What leaves the robot: for the Leader's interlock and for operators."""

    SCHEMA: ClassVar[str] = "follower_summary/1"
    phase: Phase
    cause: Text  # why the docking ended, see common.causes
    waiting: Text  # what it waits for
    trolley: Annotated[int, Field(ge=1, le=99)]
    armed: bool
    moving: bool  # the wheels turn, or may be commanded to
    # pushes against guide or queue, or holds a trolley there that is not known to be locked; after a start with
    # closed grippers true until the opposite is known
    in_contact: bool
    gripped: bool
    needs_reset: bool


@dataclass(frozen=True, config=STRICT)
class LeaderState:
    """LED array, guide, lock and queue of the Leader; its publication is the Leader's heartbeat."""

    SCHEMA: ClassVar[str] = "leader_state/2"
    ready: bool
    cause: Text  # fault of lock or LEDs; empty if none
    led_current_a: Annotated[tuple[float, ...], Field(max_length=12)]  # measured, by LED
    led_fault: bool
    guide: GuideState
    lock: LockState
    actuator_current_a: Annotated[float, Field(ge=0, le=100)]
    queue: Count | None  # locked trolleys; None: not known, the operator has to count
    led_setpoint_a: Annotated[tuple[float, ...], Field(max_length=12)] = ()  # commanded, by LED
    led_derated: bool = False  # the set-point is lower than requested, for the LEDs' temperature


@dataclass(frozen=True, config=STRICT)
class GatewayState:
    """State of a robot's gateway."""

    SCHEMA: ClassVar[str] = "gateway_state/2"
    linked: bool  # it receives from the other robot's gateway
    certificate_left_s: float  # until the certificate expires
    rules: Annotated[str, Field(max_length=64)]  # digest of its access rules, see gateway.access.rules_digest


@dataclass(frozen=True, config=STRICT)
class Health:
    """State of a process, published by each process about itself."""

    SCHEMA: ClassVar[str] = "health/1"
    process: Text
    ready: bool
    steps: Count  # since its start, as all counts here
    missed_periods: Count
    malformed: Count  # messages that it could not decode
    step_p99_ms: Annotated[float, Field(ge=0)]  # 99th percentile of its last steps' durations; for operators
