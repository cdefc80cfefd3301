"""``davpc dock``: start, abort, reset and see dockings of running robots, real or simulated."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Literal, NoReturn

import typer

from common.causes import CAUSES
from common.channels import DOCK_REQUEST, DOCKING_STATE, FOLLOWER_SUMMARY, LEADER_STATE, MISSION
from common.geometry import Pose2
from common.messages import DockRequest
from common.timing import NS_PER_S
from station.operate.answers import PATIENCE_S, answering, fields, open_link, request_id, say, show_json
from station.operate.attempts import ATTEMPTS_FILE, read_attempts, summarise
from station.operate.format import follower_line, leader_line, mission_line, report_lines
from station.operate.link import RobotLink, running_robot
from station.options import ConfigOption, JsonOption, RuntimeOption, SetOption, loaded

dock = typer.Typer(no_args_is_help=True, help="Dock, abort, reset; see where it stands. `davpc dock status`")

EXIT_INTERRUPTED = 130
_END_S = 3600.0
_SHOW_EVERY_S = 2.0
_INSTALLED = Path("/var/lib/davpc")


@dock.command(epilog="Example:  davpc dock start --trolley 2 --wait")
def start(
    trolley: Annotated[int, typer.Option(min=1, max=99, help="K: 1 is the first of the queue")] = 1,
    wait: Annotated[
        bool, typer.Option("--wait", help="wait until it is done or aborted; show phase and errors")
    ] = False,
    runtime: RuntimeOption = None,
    config: ConfigOption = None,
    as_json: JsonOption = False,
) -> None:
    """Dock trolley K: from here if one is gripped, else from the staging pose with the next one."""
    goal = loaded(config, None).docking.goal(trolley)
    with answering(as_json), open_link(runtime, config) as link:
        request = DockRequest(request_id(), link.now_ns + round(PATIENCE_S * NS_PER_S), "start", trolley)
        answer = link.ask(DOCK_REQUEST, request, PATIENCE_S)
        if answer.outcome != "accepted" or not wait:
            say(answer.outcome, answer.reason, as_json)
        try:
            say(*_ended(link, trolley, goal, shown=not as_json), as_json)
        except KeyboardInterrupt:
            typer.echo("the docking goes on: davpc dock status shows it, davpc dock abort ends it", err=True)
            raise typer.Exit(EXIT_INTERRUPTED) from None


@dock.command(epilog="Example:  davpc dock abort")
def abort(runtime: RuntimeOption = None, config: ConfigOption = None, as_json: JsonOption = False) -> None:
    """Stop and disarm now; grippers and lock stay as they are."""
    _ask("abort", runtime, config, as_json)


@dock.command(epilog="Example:  davpc dock reset")
def reset(runtime: RuntimeOption = None, config: ConfigOption = None, as_json: JsonOption = False) -> None:
    """Acknowledge a latched fault after you have looked at the robot: the next docking may begin."""
    _ask("reset", runtime, config, as_json)


@dock.command(epilog="Example:  davpc dock status --json")
def status(runtime: RuntimeOption = None, config: ConfigOption = None, as_json: JsonOption = False) -> None:
    """Show where the docking stands, and what it waits for."""
    with answering(as_json), open_link(runtime, config) as link:
        watch = link.watch(FOLLOWER_SUMMARY, LEADER_STATE)
        watch.wait(3.0)
        follower, leader = watch.newest(FOLLOWER_SUMMARY), watch.newest(LEADER_STATE)
    if as_json:
        show_json({"follower": fields(follower), "leader": fields(leader)})
    else:
        typer.echo(f"Follower: {follower_line(follower)}")
        typer.echo(f"Leader: {leader_line(leader)}")
    raise typer.Exit(0 if follower is not None else 1)


@dock.command(epilog="Example:  davpc dock report --last 50")
def report(
    last: Annotated[int, typer.Option(min=1, max=10_000, help="how many attempts")] = 20,
    state: Annotated[
        Path | None,
        typer.Option(help="folder of the reports", show_default="state_directory, or the running robot's"),
    ] = None,
    runtime: RuntimeOption = None,
    config: ConfigOption = None,
    overrides: SetOption = None,
    as_json: JsonOption = False,
) -> None:
    """Sum up the last attempts; warn of a calibration that drifts."""
    folder = state or _state_folder(loaded(config, overrides).state_directory, runtime)
    summary = summarise(*read_attempts(folder / ATTEMPTS_FILE, last))
    if as_json:
        show_json(asdict(summary))
    else:
        typer.echo("\n".join(report_lines(summary)))


@dock.command(epilog="Example:  davpc dock causes")
def causes() -> None:
    """List every cause with what it means and what to do."""
    for cause in CAUSES.values():
        typer.echo(f"{cause.code:18s} {cause.reaction}  {cause.meaning}: {cause.remedy}")


def _state_folder(configured: str, runtime: Path | None) -> Path:
    """Where the reports are: as configured, the installed robot's, or the running robot's own folder."""
    if configured:
        return Path(configured)
    return _INSTALLED if runtime is None and _INSTALLED.is_dir() else running_robot(runtime)


def _ask(action: Literal["abort", "reset"], runtime: Path | None, config: Path | None, as_json: bool) -> NoReturn:
    with answering(as_json), open_link(runtime, config) as link:
        request = DockRequest(request_id(), link.now_ns + round(PATIENCE_S * NS_PER_S), action)
        answer = link.ask(DOCK_REQUEST, request, PATIENCE_S)
    say(answer.outcome, answer.reason, as_json)


def _ended(link: RobotLink, trolley: int, goal: Pose2, shown: bool) -> tuple[str, str]:
    """Wait for the docking's end: outcome and reason.

    Args:
        link: to the robot that docks.
        trolley: K.
        goal: desired pose of {L} in {F}.
        shown: print phase and errors, at each change of phase and every two seconds.
    """
    watch, estimate = link.watch(MISSION), link.watch(DOCKING_STATE)
    end_ns = link.now_ns + round(_END_S * NS_PER_S)
    phase, due_ns = "", 0
    while link.now_ns < end_ns:
        watch.forget()
        watch.wait(2.0)
        mission = watch.newest(MISSION)
        if mission is None:
            return "unreachable", "the supervisor sends nothing any more"
        if mission.phase == "done":
            return "done", f"trolley {trolley} is docked"
        if mission.phase in ("aborted", "idle"):
            return "aborted", mission.cause or "reset meanwhile"
        if shown and (mission.phase != phase or link.now_ns >= due_ns):
            typer.echo(mission_line(mission, estimate.fresh(DOCKING_STATE), goal))
            phase, due_ns = mission.phase, link.now_ns + round(_SHOW_EVERY_S * NS_PER_S)
        link.pause(0.2)
    return "expired", "still under way after an hour"
