"""``davpc dock``: start, abort, reset and see dockings of running robots, real or simulated."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

from common.causes import CAUSES
from common.channels import DOCK_REQUEST, FOLLOWER_SUMMARY, LEADER_STATE, MISSION
from common.messages import DockRequest
from common.timing import NS_PER_S
from station.operate.answers import (
    PATIENCE_S,
    JsonOption,
    RunningOption,
    answering,
    fields,
    open_link,
    request_id,
    running_folder,
    say,
    show_json,
)
from station.operate.attempts import ATTEMPTS_FILE, read_attempts, summarise
from station.operate.link import RobotLink
from station.options import ConfigOption, SetOption, loaded

dock = typer.Typer(no_args_is_help=True, help="Dock, abort, reset; see where it stands. `davpc dock status`")

_END_S = 3600.0
_INSTALLED = Path("/var/lib/davpc")


@dock.command(epilog="Example:  davpc dock start --trolley 2 --wait")
def start(
    trolley: Annotated[int, typer.Option(min=1, max=99, help="K: 1 is the first of the queue")] = 1,
    wait: Annotated[bool, typer.Option("--wait", help="until it is done or aborted")] = False,
    runtime: RunningOption = None,
    as_json: JsonOption = False,
) -> None:
    """Dock trolley K: from here with one in the grippers, else from the staging pose with the next one."""
    with answering(as_json), open_link(runtime) as link:
        request = DockRequest(request_id(), link.now_ns + round(PATIENCE_S * NS_PER_S), "start", trolley)
        answer = link.ask(DOCK_REQUEST, request, PATIENCE_S)
        if answer.outcome != "accepted" or not wait:
            say(answer.outcome, answer.reason, as_json)
        say(*_ended(link, trolley), as_json)


@dock.command(epilog="Example:  davpc dock abort")
def abort(runtime: RunningOption = None, as_json: JsonOption = False) -> None:
    """Stop and disarm now; grippers and lock stay as they are."""
    _ask("abort", runtime, as_json)


@dock.command(epilog="Example:  davpc dock reset")
def reset(runtime: RunningOption = None, as_json: JsonOption = False) -> None:
    """Say that a person has looked: a latched fault is acknowledged, the next docking may begin."""
    _ask("reset", runtime, as_json)


@dock.command(epilog="Example:  davpc dock status --json")
def status(runtime: RunningOption = None, as_json: JsonOption = False) -> None:
    """Where the docking stands, and what it waits for."""
    with answering(as_json), open_link(runtime) as link:
        watch = link.watch(FOLLOWER_SUMMARY, LEADER_STATE)
        watch.wait(3.0)
        follower, leader = watch.newest(FOLLOWER_SUMMARY), watch.newest(LEADER_STATE)
    if as_json:
        show_json({"follower": fields(follower), "leader": fields(leader)})
    else:
        typer.echo(f"Follower: {_follower_line(follower)}")
        typer.echo(f"Leader: {leader_line(leader)}")
    raise typer.Exit(0 if follower is not None else 1)


@dock.command(epilog="Example:  davpc dock report --last 50")
def report(
    last: Annotated[int, typer.Option(min=1, max=10_000, help="attempts")] = 20,
    state: Annotated[
        Path | None,
        typer.Option(help="folder of the reports", show_default="state_directory, or the running robot's"),
    ] = None,
    config: ConfigOption = None,
    overrides: SetOption = None,
    as_json: JsonOption = False,
) -> None:
    """Sum the last attempts up; warn of a calibration that drifts."""
    folder = state or _state_folder(loaded(config, overrides).state_directory)
    summary = summarise(*read_attempts(folder / ATTEMPTS_FILE, last))
    if as_json:
        show_json(asdict(summary))
        return
    share = f"{summary.docked} of {summary.attempts} docked"
    typer.echo(share + "".join(f", {count} {code}" for code, count in summary.causes.items()))
    for label, value, unit in (
        ("lateral error on arrival", summary.mean_e_y_cm, "cm"),
        ("heading error on arrival", summary.mean_e_theta_deg, "°"),
        ("duration", summary.mean_duration_s, "s"),
    ):
        typer.echo(f"{label}: {'–' if value is None else f'{value:.2f} {unit}'} in the mean")
    typer.echo(
        f"{summary.retries} retries, {summary.pauses} pauses, {summary.interventions} interventions of the gate"
    )
    typer.echo("least margins: " + (", ".join(f"{k} {v:.3g}" for k, v in summary.least_margins.items()) or "–"))
    for warning in summary.warnings:
        typer.echo(f"WARNING {warning}")
    if summary.unreadable:
        typer.echo(f"WARNING {summary.unreadable} lines could not be read")


@dock.command(epilog="Example:  davpc dock causes")
def causes() -> None:
    """List every cause with what it means and what to do."""
    for cause in CAUSES.values():
        typer.echo(f"{cause.code:18s} {cause.reaction}  {cause.meaning}: {cause.remedy}")


def leader_line(leader: Any) -> str:
    """The Leader's state for people."""
    if leader is None:
        return "not heard"
    queue = "queue not known" if leader.queue is None else f"{leader.queue} in the queue"
    leds = "LEDs on" if leader.ready else "not ready"
    derated = ", LEDs derated" if leader.led_derated else ""
    return f"lock {leader.lock}, guide {leader.guide}, {queue}, {leds}{derated}" + (
        f": {leader.cause}" if leader.cause else ""
    )


def _follower_line(follower: Any) -> str:
    if follower is None:
        return "not heard"
    words = [f"{follower.phase}, trolley {follower.trolley}", "armed" if follower.armed else "disarmed"]
    words += ["moving"] * follower.moving + ["in contact"] * follower.in_contact
    words += ["gripped"] * follower.gripped
    words += [f"waiting for: {follower.waiting}"] if follower.waiting else []
    words += [follower.cause] if follower.cause else []
    words += ["needs a reset (davpc dock reset)"] * follower.needs_reset
    return ", ".join(words)


def _state_folder(configured: str) -> Path:
    """Where the reports lie: as configured, the installed robot's, or the running robot's own folder."""
    if configured:
        return Path(configured)
    return _INSTALLED if _INSTALLED.is_dir() else running_folder()


def _ask(action: Any, runtime: Path | None, as_json: bool) -> NoReturn:
    with answering(as_json), open_link(runtime) as link:
        request = DockRequest(request_id(), link.now_ns + round(PATIENCE_S * NS_PER_S), action)
        answer = link.ask(DOCK_REQUEST, request, PATIENCE_S)
    say(answer.outcome, answer.reason, as_json)


def _ended(link: RobotLink, trolley: int) -> tuple[str, str]:
    """Wait for the docking's end: outcome and reason."""
    watch = link.watch(MISSION)
    end_ns = link.now_ns + round(_END_S * NS_PER_S)
    while link.now_ns < end_ns:
        watch.forget()
        watch.wait(2.0)
        mission = watch.newest(MISSION)
        if mission is None:
            return "unreachable", "the supervisor fell silent"
        if mission.phase == "done":
            return "done", f"trolley {trolley} is docked"
        if mission.phase in ("aborted", "idle"):
            return "aborted", mission.cause or "reset meanwhile"
        link.pause(0.2)
    return "expired", "still under way after an hour"
