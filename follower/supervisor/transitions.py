"""The table of a docking's phases: which event leads from which phase to which.

``python -m follower.supervisor.transitions`` prints it as ARCHITECTURE.md shows it; a test holds the two equal.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

from common.messages import PHASES, Phase

Event = Literal[
    "start",
    "gripped",
    "armed",
    "leds_lost",
    "leds_found",
    "arrived",
    "unreachable",
    "contact",
    "connected",
    "confirmed",
    "released",
    "clear",
    "late",
    "failed",
    "abort",
    "reset",
]

ACTIVE: Final[tuple[Phase, ...]] = tuple(
    phase for phase in PHASES if phase not in ("idle", "done", "aborted", "manual")
)
ENDED: Final[tuple[Phase, ...]] = ("idle", "done", "aborted")
# nothing ahead is in contact in these: a stop may be re-armed, and the path back is free
FREE: Final[tuple[Phase, ...]] = ("staging", "acquire", "search", "approach")
# the trolley meets guide or queue
IN_CONTACT: Final[tuple[Phase, ...]] = ("insert", "push", "lock", "release")


@dataclass(frozen=True)
class Transition:
    """One row: in ``phase``, ``event`` leads to ``to``; ``when`` says in words what the event is there."""

    phase: Phase
    event: Event
    to: Phase
    when: str


TABLE: Final[tuple[Transition, ...]] = (
    Transition("idle", "start", "staging", "the operator asks"),
    Transition("done", "start", "staging", "the operator asks for the next trolley"),
    Transition("aborted", "start", "staging", "the operator asks, and no reset is needed"),
    Transition("staging", "gripped", "acquire", "at the staging pose with a trolley in the grippers"),
    Transition("acquire", "armed", "approach", "all healthy for 0.5 s, the drives are enabled"),
    Transition("acquire", "leds_lost", "search", "no LEDs within the time to acquire them; at most three searches"),
    Transition("search", "leds_found", "acquire", "the array is in view again"),
    Transition("approach", "leds_lost", "search", "paused for too long without LEDs, away from the goal"),
    Transition("approach", "unreachable", "staging", "comes no nearer, all healthy; at most three retries"),
    Transition("approach", "arrived", "insert", "at the goal, settled"),
    Transition("insert", "contact", "push", "the joint torques show guide or queue"),
    Transition("push", "connected", "lock", "rigid by joint torque; the distance pushed and the LEDs agree"),
    Transition("lock", "confirmed", "release", "the Leader confirms that the trolley is locked"),
    Transition("release", "released", "retract", "both grippers are open"),
    Transition("retract", "clear", "done", "backed away"),
    Transition("staging", "late", "staging", "S1: deadline missed; re-armed at most three times in 20 s"),
    *(
        Transition(phase, "late", "acquire", "S1: deadline missed; re-armed at most three times in 20 s")
        for phase in ("acquire", "search", "approach")
    ),
    *(Transition(phase, "failed", "aborted", "with a named cause; S2 needs a reset") for phase in ACTIVE),
    *(Transition(phase, "abort", "aborted", "the operator asks") for phase in ACTIVE),
    *(Transition(phase, "reset", "idle", "the operator asks") for phase in ENDED),
)
_NEXT: Final = {(row.phase, row.event): row.to for row in TABLE}


def next_phase(phase: Phase, event: Event) -> Phase:
    """Where an event leads.

    Raises:
        KeyError: the table knows no such event in this phase.
    """
    return _NEXT[phase, event]


def as_markdown() -> str:
    """The table as ARCHITECTURE.md shows it: rows that differ in their phase alone are one."""
    rows: dict[tuple[str, str, str], list[str]] = {}
    for row in TABLE:
        rows.setdefault((row.event, row.to, row.when), []).append(row.phase)
    lines = ["| in | event | to | when |", "|---|---|---|---|"]
    for (event, to, when), phases in rows.items():
        where = "any phase of a docking" if tuple(phases) == ACTIVE else ", ".join(phases)
        lines.append(f"| {where} | {event} | {to} | {when} |")
    return "\n".join(lines)


if __name__ == "__main__":
    print(as_markdown())  # noqa: T201 - its purpose
