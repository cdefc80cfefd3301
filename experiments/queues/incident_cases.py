"""The incidents: what happens, when, and which ends are right by ``docs/safety.md`` (failure modes).

A docking that does not succeed still holds its trolley.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from common.messages import Phase


@dataclass(frozen=True)
class Incident:
    """One incident: in which phase and how long after its start, for how long, which ends are right.

    Attributes:
        ends: the causes that are right, "done" for a docking that succeeds.
        names: text that the cause must contain; after a docking that succeeded, what it paused for.
        never_arms: nothing may be armed.
        pauses: what it must lead to meanwhile: a pause alone, or a search after it.
        rearms: it must have been stopped, disarmed and re-armed meanwhile.
        jam_m: how far before its place the trolley is blocked.
    """

    name: str
    deed: Literal["hide", "jam", "bolt", "switch_open", "switch_closed", "led", "leader", "slip", "stall"]
    phase: Phase
    ends: tuple[str, ...]
    trolley: int = 1
    delay_s: float = 0.2
    duration_s: float = 0.0
    names: str = ""
    never_arms: bool = False
    pauses: Literal["", "pause", "search"] = ""
    rearms: bool = False
    jam_m: float = 0.08

    @property
    def first(self) -> int:
        """First trolley of the run: only one that is gripped during the run passes through staging."""
        return self.trolley - 1 if self.phase == "staging" else self.trolley


_LED_PHASES: tuple[Phase, ...] = (
    "staging", "acquire", "search", "approach", "insert", "push", "lock", "release", "retract",
)  # fmt: skip
# once the Leader has confirmed the lock, nothing more is requested of it
_OFF_ENDS: dict[Phase, str] = {
    "staging": "leader_lost",
    "acquire": "leader_lost",
    "search": "leader_lost",
    "approach": "leader_lost",
    "insert": "leader_lost",
    "push": "leader_lost",
    "lock": "leader_silent",
    "release": "done",
    "retract": "done",
}
CASES = {
    case.name: case
    for case in (
        Incident("hidden 0.3 s", "hide", "approach", ("done",), delay_s=2.0, duration_s=0.3, pauses="pause"),
        Incident("hidden 1 s", "hide", "approach", ("done",), delay_s=2.0, duration_s=1.0, pauses="pause"),
        Incident("hidden 5 s", "hide", "approach", ("done",), delay_s=2.0, duration_s=5.0, pauses="search"),
        Incident("jam of trolley 1", "jam", "approach", ("contact_early",)),
        # so near its place joint torques are as at the guide: the camera or the seat's switch shows the difference
        Incident(
            "late jam of trolley 1",
            "jam",
            "approach",
            ("contact_early", "contact_elsewhere", "lock_refused"),
            jam_m=0.05,
        ),
        Incident("jam of trolley 2", "jam", "approach", ("contact_early",), trolley=2),
        Incident(
            "late jam of trolley 2", "jam", "approach", ("contact_early", "contact_elsewhere"), trolley=2, jam_m=0.05
        ),
        Incident("lock's bolt blocked", "bolt", "approach", ("lock_refused",), names="jammed"),
        Incident(
            "lock switch stuck open", "switch_open", "approach", ("lock_refused",), names="lock switch not reached"
        ),
        Incident(
            "lock switch stuck closed",
            "switch_closed",
            "idle",
            ("acquire_timeout",),
            names="lock switch closed",
            never_arms=True,
        ),
        Incident(
            "lock switch sticks closed in approach",
            "switch_closed",
            "approach",
            ("lock_refused", "lock_implausible"),
            names="lock switch closed",
        ),
        Incident(
            "lock switch sticks closed in lock",
            "switch_closed",
            "lock",
            ("lock_refused",),
            names="lock switch closed",
        ),
        # an image that stands while the wheels turn may as well be a frozen camera's: the cause names both, and the
        # second time in a row ends it
        Incident(
            "wheels slip for 1 s",
            "slip",
            "approach",
            ("done",),
            delay_s=4.0,
            duration_s=1.0,
            names="slipping wheels",
            pauses="pause",
        ),
        Incident(
            "wheels slip for good",
            "slip",
            "approach",
            ("not_following",),
            delay_s=4.0,
            duration_s=math.inf,
            names="slipping wheels",
        ),
        Incident(
            "controller stalls for 0.2 s", "stall", "approach", ("done",), delay_s=2.0, duration_s=0.2, rearms=True
        ),
        *(
            Incident(f"LED dies in {phase}", "led", phase, ("done", "few_leds"), 2 if phase == "staging" else 1)
            for phase in _LED_PHASES
        ),
        *(
            Incident(f"Leader off in {phase}", "leader", phase, (ends,), 2 if phase == "staging" else 1)
            for phase, ends in _OFF_ENDS.items()
        ),
    )
}
