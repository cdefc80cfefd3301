"""How a robot, a gateway or a process is doing."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field
from pydantic.dataclasses import dataclass

from common.messages.fields import STRICT, Count, GuideState, LockState, Phase, Text


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
