"""Inputs and outputs of one step: of the supervisor, and of a phase within it."""

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
    """Inputs of one step; None is what is missing or too old.

    Attributes:
        now_ns: time of the step.
        state: relative pose and features.
        drives: what the drives measured, and the gate's state.
        arms: contact, connection, grip.
        leader: state of the Leader's LEDs, guide and lock.
        controller_alive: a command arrived in time.
        requests: for the docking.
        lock_answers: of the Leader to lock requests.
        restarted: a process that began a new run since the last step; empty: none.
        unfit: why no new docking may begin although the robots are well (a full disk); empty: nothing.
        late: a process whose loops come late; empty: none.
        malformed: a process whose last two messages or more could not be decoded; empty: none.
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
    late: str = ""
    malformed: str = ""


@dataclass(frozen=True, kw_only=True)
class PhaseOutputs:
    """What a phase asks for: motion of the base, speed caps, and at most one request to the Leader.

    ``waiting`` names what it waits for; empty while it proceeds.
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
    """End of a phase: the event, with its cause if it has one."""

    event: Event
    cause: str = ""


@dataclass(frozen=True, kw_only=True)
class SupervisorOutputs:
    """Mission, summary for the Leader, answers to requests, at most one request to the Leader."""

    mission: Mission
    summary: FollowerSummary
    answers: tuple[Answer, ...] = field(default=())
    lock_request: LockRequest | None = None


def straight(speed_m_s: float, contact_expected: bool = False, waiting: str = "") -> PhaseOutputs:
    """Drive straight ahead, or back for a negative speed."""
    return PhaseOutputs(
        motion="straight",
        straight_speed_m_s=speed_m_s,
        v_max_m_s=abs(speed_m_s),
        contact_expected=contact_expected,
        waiting=waiting,
    )


def turning(rate_rad_s: float) -> PhaseOutputs:
    """Turn in place, to the left for a positive rate."""
    return PhaseOutputs(motion="turn", turn_rate_rad_s=rate_rad_s, w_max_rad_s=abs(rate_rad_s), waiting="LEDs")
