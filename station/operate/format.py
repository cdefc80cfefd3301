"""Running robots in words: lines for the operator, from what their processes report."""

from __future__ import annotations

from common.docking_errors import docked_error
from common.geometry import Pose2
from common.messages import DockingState, FollowerSummary, LeaderState, Mission
from station.operate.attempts import Summary

SILENT = "no state received"


def leader_line(leader: LeaderState | None) -> str:
    """The Leader's lock, guide, queue and LEDs."""
    if leader is None:
        return SILENT
    queue = "queue not known" if leader.queue is None else f"{leader.queue} in the queue"
    leds = "LEDs on" if leader.ready else "not ready"
    derated = ", LEDs derated" if leader.led_derated else ""
    cause = f": {leader.cause}" if leader.cause else ""
    return f"lock {leader.lock}, guide {leader.guide}, {queue}, {leds}{derated}{cause}"


def led_lines(leader: LeaderState) -> list[str]:
    """Commanded and drawn current of each LED."""
    commanded = (*leader.led_setpoint_a, *[0.0] * len(leader.led_current_a))
    return [
        f"LED {number}: commanded {commanded[number]:.2f} A, draws {drawn:.2f} A"
        for number, drawn in enumerate(leader.led_current_a)
    ]


def follower_line(follower: FollowerSummary | None) -> str:
    """Where the docking stands, and what it waits for."""
    if follower is None:
        return SILENT
    words = [f"{follower.phase}, trolley {follower.trolley}", "armed" if follower.armed else "disarmed"]
    words += ["moving"] * follower.moving + ["in contact"] * follower.in_contact
    words += ["gripped"] * follower.gripped
    words += [f"waiting for: {follower.waiting}"] if follower.waiting else []
    words += [follower.cause] if follower.cause else []
    words += ["needs a reset (davpc dock reset)"] * follower.needs_reset
    return ", ".join(words)


def mission_line(mission: Mission, state: DockingState | None, goal: Pose2) -> str:
    """The phase of a docking under way, where the Follower stands, and what it waits for."""
    waiting = f"  waits for {mission.waiting}" if mission.waiting else ""
    return f"{mission.phase:10s} {place(state, goal)}{waiting}"


def place(state: DockingState | None, goal: Pose2) -> str:
    """Where the Follower stands: its estimated error against the goal.

    Args:
        state: the estimate, None if there is none.
        goal: desired pose of {L} in {F}.
    """
    if state is None or not state.valid:
        return "LEDs not seen"
    error = docked_error(Pose2(state.x_m, state.y_m, state.theta_rad).inverse(), goal)
    return f"to goal {error.e_x_m:.2f} m  lateral {100 * error.e_y_m:+.1f} cm  heading {error.e_theta_deg:+.2f}°"


def report_lines(summary: Summary) -> list[str]:
    """Past attempts summed up."""
    causes = "".join(f", {count} {code}" for code, count in summary.causes.items())
    lines = [f"{summary.docked} of {summary.attempts} docked{causes}"]
    for label, value, unit in (
        ("lateral error on arrival", summary.mean_e_y_cm, " cm"),
        ("heading error on arrival", summary.mean_e_theta_deg, "°"),
        ("duration", summary.mean_duration_s, " s"),
    ):
        lines.append(f"{label}: {'–' if value is None else f'mean {value:.2f}{unit}'}")
    lines.append(
        f"{summary.retries} retries, {summary.pauses} pauses, {summary.interventions} interventions of the gate"
    )
    margins = ", ".join(f"{name} {value:.3g}" for name, value in summary.least_margins.items())
    lines.append(f"least margins: {margins or '–'}")
    lines += [f"WARNING {warning}" for warning in summary.warnings]
    if summary.unreadable:
        lines.append(f"WARNING {summary.unreadable} lines could not be read")
    return lines
