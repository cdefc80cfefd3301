"""What the supervisor sees in one step, and what it decides."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from common.messages import (
    Answer,
    ArmState,
    DockingState,
    DockRequest,
    Drives,
    FollowerSummary,
    LeaderState,
    LockRequest,
    Mission,
)
from follower.supervisor.transitions import Event

Grip = Literal["open", "closed"]


@dataclass(frozen=True, kw_only=True)
class SupervisorInputs:
    """One step's observations; None is what is missing or too old.

    ``restarted`` names a process that began a new run since the last step, or is empty; ``unfit`` says why no new
    docking may begin, whatever else is well (a full disk), or is empty.
    """

    now_ns: int
    state: DockingState | None
    drives: Drives | None
    arms: ArmState | None
    leader: LeaderState | None
    controller_alive: bool
    requests: tuple[DockRequest, ...] = ()
    lock_answers: tuple[Answer, ...] = ()
    restarted: str = ""
    unfit: str = ""


@dataclass(frozen=True, kw_only=True)
class PhaseOutputs:
    """What a phase wants now: motion of the base, its caps, grippers, and at most one request to the Leader.

    ``waiting`` names what it waits for; empty while nothing keeps it from going on.
    """

    motion: Literal["hold", "servo", "straight", "turn"] = "hold"
    straight_speed_m_s: float = 0.0
    turn_rate_rad_s: float = 0.0
    v_max_m_s: float = 0.0
    w_max_rad_s: float = 0.0
    contact_expected: bool = False
    waiting: str = ""
    lock_request: LockRequest | None = None


@dataclass(frozen=True)
class PhaseResult:
    """A phase is over: the event that ends it, and its cause if it is one to be named."""

    event: Event
    cause: str = ""


@dataclass(frozen=True, kw_only=True)
class SupervisorOutputs:
    """What the supervisor wants: the mission, what others may know, answers, at most one request to the Leader."""

    mission: Mission
    summary: FollowerSummary
    answers: tuple[Answer, ...] = field(default=())
    lock_request: LockRequest | None = None


def straight(speed_m_s: float, contact_expected: bool = False, waiting: str = "") -> PhaseOutputs:
    """Straight ahead, or back for a negative speed."""
    return PhaseOutputs(
        motion="straight",
        straight_speed_m_s=speed_m_s,
        v_max_m_s=abs(speed_m_s),
        contact_expected=contact_expected,
        waiting=waiting,
    )


def turning(rate_rad_s: float) -> PhaseOutputs:
    """In place, to the left for a positive rate."""
    return PhaseOutputs(motion="turn", turn_rate_rad_s=rate_rad_s, w_max_rad_s=abs(rate_rad_s), waiting="LEDs")
