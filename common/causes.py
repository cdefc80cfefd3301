"""Why a docking ended: every code, what it means, how it stops, and what a person does about it.

A cause on the wire is ``code`` or ``code: detail``. Reactions are those of the safety concept: **S1** stops and
disarms, a new docking may begin at once; **S2** stops and latches until a person has reset it. Whatever ends one
in contact latches too, and the grippers and the lock stay as they are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal


@dataclass(frozen=True)
class Cause:
    """One code."""

    code: str
    reaction: Literal["S1", "S2"]
    meaning: str
    remedy: str


# what the bridge says, before a colon, while drives are not heard or frames cannot be genuine: S1, it may pass
NODE_SILENT, BAD_FRAMES = "node_silent", "bad_frames"
_LOOK: Final = "look at the robots, then `davpc dock reset`"
_CAUSES: Final[tuple[Cause, ...]] = (
    Cause("operator_abort", "S1", "a person asked for it", "`davpc dock start` when ready"),
    Cause(
        "drives_silent", "S1", "no measurement of the drives for 0.25 s", "see the CAN bridge's log, `davpc can scan`"
    ),
    Cause("drives_disarmed", "S1", "the drives disarmed by themselves", "see the CAN bridge's log"),
    Cause("stop_input", "S2", "emergency or protective stop, or their input is silent", f"clear the stop, {_LOOK}"),
    Cause("drive_fault", "S2", "a drive reported a fault, or the bus was lost", f"`davpc can monitor`; {_LOOK}"),
    Cause(
        "gate_stop", "S1", "the gate stopped the wheels for the named rule", "see which process was late or restarted"
    ),
    Cause("restarted", "S1", "the named process restarted: a docking is never resumed", "see its log, start again"),
    Cause("slip", "S2", "the trolley slipped from a gripper", f"take the trolley away, {_LOOK}"),
    Cause("collision", "S2", "a joint torque spiked", f"see what was hit, {_LOOK}"),
    Cause("contact_early", "S2", "rigid resistance before the trolley can have arrived", f"clear the way, {_LOOK}"),
    Cause(
        "contact_elsewhere", "S2", "rigid, but the LEDs say not where the queue is", f"see what it stands at, {_LOOK}"
    ),
    Cause(
        "no_contact", "S2", "pushed to the limit without meeting guide or queue", f"see where the queue is, {_LOOK}"
    ),
    Cause("push_timeout", "S2", "the push took too long", f"see what holds the trolley, {_LOOK}"),
    Cause("lock_refused", "S2", "the Leader refused, for the reason that it gives", f"`davpc lock status`; {_LOOK}"),
    Cause("lock_expired", "S2", "the request came too late to the Leader", f"see the link, {_LOOK}"),
    Cause("lock_timeout", "S2", "the Leader is heard, but its lock did not close", f"`davpc lock status`; {_LOOK}"),
    Cause("leader_silent", "S2", "in contact, and the Leader's word did not come", f"mend the link, {_LOOK}"),
    Cause("lock_implausible", "S2", "the lock reads closed before there was contact", f"see its switch, {_LOOK}"),
    Cause("release_timeout", "S2", "the grippers did not open", f"see the grippers, {_LOOK}"),
    Cause("retract_timeout", "S2", "backing away took too long", f"see what holds the robot, {_LOOK}"),
    Cause("staging_timeout", "S1", "what is named kept it from the staging pose", "mend it, start again"),
    Cause("no_trolley", "S1", "no trolley came into the grippers", "bring one, start again"),
    Cause("acquire_timeout", "S1", "what is named kept it from arming", "mend it, start again"),
    Cause("search_timeout", "S1", "turning for the LEDs took too long", "see what holds the robot"),
    Cause("leds_lost", "S1", "the LEDs were not found again", "clear the view; `davpc led status`; start again"),
    Cause("few_leds", "S1", "too few LEDs to tell the goal well enough", "`davpc led status`; mend the array"),
    Cause(
        "lock_disagrees", "S1", "an array is seen where the Leader cannot be", "look for a second array or a mirror"
    ),
    Cause("leader_lost", "S1", "LEDs and the Leader's heartbeat are both gone", "see whether the Leader has power"),
    Cause("camera_silent", "S1", "no usable image came", "see the camera's log, its cable"),
    Cause("estimator_silent", "S1", "no docking state came", "see the estimator's log"),
    Cause("unwell", "S1", "what is named was not well for too long", "see that process' log"),
    Cause("too_many_pauses", "S1", "paused more than five times for what is named", "see to what is named"),
    Cause("approach_timeout", "S1", "the approach took too long", "see what keeps it; start again from further away"),
    Cause("no_progress", "S1", "the approach came no nearer", "see the floor and the load; start again"),
    Cause("overshot", "S1", "came nearer than the goal", "see the floor; start again from further away"),
)
CAUSES: Final[dict[str, Cause]] = {cause.code: cause for cause in _CAUSES}


def cause_code(text: str) -> str:
    """The code of ``code: detail``."""
    return text.partition(":")[0]


def needs_reset(text: str) -> bool:
    """Whether a person has to reset before anything begins again; also for a code that nobody knows."""
    known = CAUSES.get(cause_code(text))
    return known is None or known.reaction == "S2"


def as_markdown() -> str:
    """The table for people, as docs/causes.md shows it."""
    lines = ["| cause | reaction | means | do |", "|---|---|---|---|"]
    lines += [f"| {cause.code} | {cause.reaction} | {cause.meaning} | {cause.remedy} |" for cause in _CAUSES]
    return "\n".join(lines)


if __name__ == "__main__":
    print(as_markdown())  # noqa: T201 - its purpose
