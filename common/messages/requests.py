"""What a person or a process asks another for, and the answer."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from common.messages.fields import STRICT, Ns, Outcome, Text


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
