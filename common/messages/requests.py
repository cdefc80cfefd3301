"""Requests of operators and processes, and the answer."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from common.messages.fields import STRICT, Ns, Outcome, RequestId, Text


@dataclass(frozen=True, config=STRICT)
class DockRequest:
    """A request to the supervisor, carried out once for each id."""

    SCHEMA: ClassVar[str] = "dock_request/1"
    id: RequestId
    expires_ns: Ns  # not carried out after this
    action: Literal["start", "abort", "reset"]
    trolley: Annotated[int, Field(ge=1, le=99)] = 1  # K: its place in the queue

    @property
    def urgent(self) -> bool:
        """Whether it is taken however many wait."""
        return self.action == "abort"


@dataclass(frozen=True, config=STRICT)
class ManualRequest:
    """The operator wants to move the robot by hand; ends as soon as commands of its epoch cease."""

    SCHEMA: ClassVar[str] = "manual_request/1"
    id: RequestId
    expires_ns: Ns  # not carried out after this
    action: Literal["start", "stop"]  # arms and ends the phase "manual"
    grip: Literal["open", "closed", "stay"] = "stay"
    lift_m: Annotated[float, Field(ge=0, le=1)] | None = None  # None: the lift stays

    @property
    def urgent(self) -> bool:
        """Whether it is taken however many wait."""
        return self.action == "stop"


@dataclass(frozen=True, config=STRICT)
class LockRequest:
    """A request of the supervisor or the operator to the Leader's lock."""

    SCHEMA: ClassVar[str] = "lock_request/2"
    id: RequestId
    valid_for_ms: Annotated[int, Field(ge=1, le=60_000)]  # from receipt: clocks of two robots are never compared
    # lock: close behind trolley 1. confirm: is it still locked now that `trolley` stands in the queue?
    # unlock: release the queue. reset: clear a lock fault. count: set the number of trolleys in the queue
    action: Literal["lock", "confirm", "unlock", "reset", "count"]
    trolley: Annotated[int, Field(ge=0, le=99)] = 1  # for lock and confirm its place, for count the number (0: none)
    confirmed: bool = False  # by the operator: required for unlock


@dataclass(frozen=True, config=STRICT)
class LedRequest:
    """The operator sets the current of one LED or of all."""

    SCHEMA: ClassVar[str] = "led_request/1"
    id: RequestId
    valid_for_ms: Annotated[int, Field(ge=1, le=60_000)]  # from receipt
    led: Annotated[int, Field(ge=0, lt=12)] | None  # None: all
    current_a: Annotated[float, Field(ge=0, le=5)] | None  # 0: off, None: as configured


@dataclass(frozen=True, config=STRICT)
class Answer:
    """The outcome of a request."""

    SCHEMA: ClassVar[str] = "answer/1"
    id: Text  # of the request
    outcome: Outcome
    reason: Text
