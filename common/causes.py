"""Why a docking ended: every code, its meaning, its reaction, and the operator's remedy.

A cause on the wire is ``code`` or ``code: detail``. Reactions are those of docs/safety.md: **S1** stops and disarms,
a new docking may begin at once; **S2** stops and latches until the operator resets it. Whatever ends a docking in
contact latches too, and the grippers and the lock keep their state.
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


# the bridge's causes, before a colon, for what may pass by itself (S1)
NODE_SILENT, BAD_FRAMES, BUS_LOST = "node_silent", "bad_frames", "bus_lost"
# the supervisor's, for what may pass as well
BAD_MESSAGE: Final = "bad_message"
_LOOK: Final = "look at the robots, then `davpc dock reset`"
_CAUSES: Final[tuple[Cause, ...]] = (
    Cause("operator_abort", "S1", "the operator aborted it", "`davpc dock start` when ready"),
    Cause(
        "drives_silent", "S1", "no measurement of the drives for 0.25 s", "see the CAN bridge's log, `davpc can scan`"
    ),
    Cause("drives_disarmed", "S1", "the drives disarmed by themselves", "see the CAN bridge's log"),
    Cause("stop_input", "S2", "emergency or protective stop, or their input is silent", f"clear the stop, {_LOOK}"),
    Cause("drive_fault", "S2", "a drive reported a fault, or restarted", f"`davpc can monitor`; {_LOOK}"),
    Cause(
        "gate_stop",
        "S1",
        "the gate stopped the wheels by the named rule",
        "find the process that missed its deadline or restarted",
    ),
    Cause(
        BAD_MESSAGE,
        "S1",
        "messages of the named process could not be decoded, two in a row: NaN, out of range, damaged",
        "see the logs of that process and of the supervisor",
    ),
    Cause("restarted", "S1", "the named process restarted; a docking is never resumed", "see its log, start again"),
    Cause("slip", "S2", "the trolley slipped from a gripper", f"remove the trolley, {_LOOK}"),
    Cause("collision", "S2", "a joint torque spiked", f"find what was hit, {_LOOK}"),
    Cause("contact_early", "S2", "rigid resistance before the trolley can have arrived", f"clear the path, {_LOOK}"),
    Cause(
        "contact_elsewhere",
        "S2",
        "rigid resistance, but not where the LEDs show the queue",
        f"find what blocks the trolley, {_LOOK}",
    ),
    Cause("no_contact", "S2", "pushed to the limit without meeting guide or queue", f"find the queue, {_LOOK}"),
    Cause("push_timeout", "S2", "the push took too long", f"find what holds the trolley, {_LOOK}"),
    Cause("lock_refused", "S2", "the Leader refused, for the reason given", f"`davpc lock status`; {_LOOK}"),
    Cause("lock_expired", "S2", "the lock request reached the Leader too late", f"check the link, {_LOOK}"),
    Cause("lock_timeout", "S2", "the Leader answers, but its lock did not close", f"`davpc lock status`; {_LOOK}"),
    Cause("leader_silent", "S2", "in contact, but the Leader did not answer", f"restore the link, {_LOOK}"),
    Cause("lock_implausible", "S2", "the lock reads closed before there was contact", f"check its switch, {_LOOK}"),
    Cause("release_timeout", "S2", "the grippers did not open", f"check the grippers, {_LOOK}"),
    Cause("retract_timeout", "S2", "backing away took too long", f"find what holds the robot, {_LOOK}"),
    Cause(
        "staging_timeout",
        "S1",
        "did not reach the staging pose, for the named reason",
        "remove the named reason, start again",
    ),
    Cause("no_trolley", "S1", "no trolley came into the grippers", "bring one, start again"),
    Cause("acquire_timeout", "S1", "could not arm, for the named reason", "remove the named reason, start again"),
    Cause("search_timeout", "S1", "turning to find the LEDs took too long", "find what holds the robot, start again"),
    Cause("leds_lost", "S1", "the LEDs were not found again", "clear the view; `davpc led status`; start again"),
    Cause(
        "wrong_array",
        "S1",
        "the array in view does not show the light code of this pair",
        "`davpc led status`; compare leds.code of both robots; start again",
    ),
    Cause(
        "few_leds",
        "S1",
        "too few LEDs to determine the goal well enough",
        "`davpc led status`; repair the array, start again",
    ),
    Cause(
        "lock_disagrees",
        "S1",
        "an array is in view where the Leader cannot be",
        "look for a second array or a mirror, start again",
    ),
    Cause("leader_lost", "S1", "LEDs and Leader's heartbeat are both gone", "check the Leader's power, start again"),
    Cause("camera_silent", "S1", "no usable image", "see the camera's log, its cable; start again"),
    Cause(
        "not_following",
        "S1",
        "the image did not follow the wheels, nor a turn on the spot: frozen camera or slipping wheels",
        "look at the floor under the wheels; see the camera's log, its cable; start again",
    ),
    Cause("estimator_silent", "S1", "no docking state", "see the estimator's log, start again"),
    Cause("unwell", "S1", "the named component stayed unhealthy too long", "see its log, start again"),
    Cause(
        "too_many_pauses",
        "S1",
        "paused more than five times for the named reason",
        "remove the named reason, start again",
    ),
    Cause("approach_timeout", "S1", "the approach took too long", "find what slows it; start from further away"),
    Cause("no_progress", "S1", "the approach came no nearer", "check floor and load; start again"),
    Cause("overshot", "S1", "drove past the goal", "check the floor; start from further away"),
)
CAUSES: Final[dict[str, Cause]] = {cause.code: cause for cause in _CAUSES}


def cause_code(text: str) -> str:
    """The code of ``code: detail``."""
    return text.partition(":")[0]


def needs_reset(text: str) -> bool:
    """Whether an operator has to reset before the next docking; an unknown code counts as yes."""
    known = CAUSES.get(cause_code(text))
    return known is None or known.reaction == "S2"


def as_markdown() -> str:
    """The table as docs/causes.md shows it."""
    lines = ["| cause | reaction | means | do |", "|---|---|---|---|"]
    lines += [f"| {cause.code} | {cause.reaction} | {cause.meaning} | {cause.remedy} |" for cause in _CAUSES]
    return "\n".join(lines)


if __name__ == "__main__":
    print(as_markdown())  # noqa: T201 - its purpose
