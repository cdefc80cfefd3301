"""``davpc led`` and ``davpc lock``: the Leader's array and lock, of running robots, real or simulated."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, NoReturn

import typer

from common.channels import LEADER_STATE, LED_REQUEST, LOCK_REQUEST
from common.messages import LeaderState, LedRequest, LockRequest
from station.operate.answers import PATIENCE_S, answering, fields, open_link, request_id, say, show_json
from station.operate.format import SILENT, leader_line, led_lines
from station.options import ConfigOption, JsonOption, RuntimeOption

led = typer.Typer(no_args_is_help=True, help="The Leader's LEDs. `davpc led status`")
lock = typer.Typer(no_args_is_help=True, help="The Leader's guide and lock. `davpc lock status`")
YesOption = Annotated[bool, typer.Option("--yes", help="confirm without being asked")]
# the Leader answers when the lock has arrived: a jam and the retraction after it included
_TRAVEL_S = 15.0


@led.command("set", epilog="Example:  davpc led set 0.8 --led 2")
def led_set(
    current: Annotated[str, typer.Argument(help="amperes, off, or on: as configured")],
    number: Annotated[int | None, typer.Option("--led", min=0, max=11, help="which one", show_default="all")] = None,
    runtime: RuntimeOption = None,
    config: ConfigOption = None,
    as_json: JsonOption = False,
) -> None:
    """Set the current of one LED, or of all."""
    amperes = {"on": None, "off": 0.0}.get(current, current)
    try:
        request = LedRequest(
            request_id(), round(PATIENCE_S * 1000), number, None if amperes is None else float(amperes)
        )
    except ValueError:
        say("refused", f"{current!r}: write amperes from 0 to 5, on, or off", as_json)
    with answering(as_json), open_link(runtime, config) as link:
        answer = link.ask(LED_REQUEST, request, PATIENCE_S)
    say(answer.outcome, answer.reason, as_json)


@led.command("status", epilog="Example:  davpc led status")
def led_status(runtime: RuntimeOption = None, config: ConfigOption = None, as_json: JsonOption = False) -> None:
    """Show the current that each LED is commanded and draws."""
    leader = _leader_state(runtime, config, as_json)
    if as_json:
        show_json(fields(leader) or {})
    else:
        typer.echo("\n".join(led_lines(leader)))
        typer.echo(f"Leader: {leader_line(leader)}")
    raise typer.Exit(1 if leader.led_fault else 0)


@lock.command("status", epilog="Example:  davpc lock status")
def lock_status(runtime: RuntimeOption = None, config: ConfigOption = None, as_json: JsonOption = False) -> None:
    """Show where the lock is, and how many trolleys stand behind it."""
    leader = _leader_state(runtime, config, as_json)
    if as_json:
        show_json(fields(leader) or {})
    else:
        typer.echo(f"Leader: {leader_line(leader)}")
    raise typer.Exit(1 if leader.lock == "fault" else 0)


@lock.command("close", epilog="Example:  davpc lock close")
def lock_close(runtime: RuntimeOption = None, config: ConfigOption = None, as_json: JsonOption = False) -> None:
    """Close the lock behind a beam that is in its seat."""
    _ask("lock", runtime, config, as_json)


@lock.command("open", epilog="Example:  davpc lock open --yes")
def lock_open(
    yes: YesOption = False, runtime: RuntimeOption = None, config: ConfigOption = None, as_json: JsonOption = False
) -> None:
    """Release the queue: asks first, and never while the Follower moves or holds a trolley against it."""
    confirmed = yes or _sure("this releases the whole queue: sure?", as_json)
    _ask("unlock", runtime, config, as_json, confirmed=confirmed)


@lock.command("reset", epilog="Example:  davpc lock reset --yes")
def lock_reset(
    yes: YesOption = False, runtime: RuntimeOption = None, config: ConfigOption = None, as_json: JsonOption = False
) -> None:
    """Clear a lock fault after you have looked; with --yes a bolt that is half way is retracted."""
    _ask("reset", runtime, config, as_json, confirmed=yes)


@lock.command("count", epilog="Example:  davpc lock count 3 --yes")
def lock_count(
    trolleys: Annotated[int, typer.Argument(min=0, max=99, help="locked in the queue")],
    yes: YesOption = False,
    runtime: RuntimeOption = None,
    config: ConfigOption = None,
    as_json: JsonOption = False,
) -> None:
    """Set how many trolleys stand in the queue, where the Leader does not know."""
    confirmed = yes or _sure(f"{trolleys} trolleys stand in the queue: sure?", as_json)
    _ask("count", runtime, config, as_json, trolleys, confirmed)


def _leader_state(runtime: Path | None, config: Path | None, as_json: bool) -> LeaderState:
    with answering(as_json), open_link(runtime, config) as link:
        watch = link.watch(LEADER_STATE)
        watch.wait(3.0)
        leader = watch.newest(LEADER_STATE)
    if leader is None:
        say("unreachable", f"Leader: {SILENT}", as_json)
    return leader


def _sure(question: str, as_json: bool) -> bool:
    """The operator's word at a terminal, without which nothing is asked; a program confirms with --yes."""
    if as_json:
        return False
    try:
        if typer.confirm(question):
            return True
    except typer.Abort:
        pass
    typer.echo("not confirmed: nothing was asked of the Leader", err=True)
    raise typer.Exit(1)


def _ask(
    action: Literal["lock", "unlock", "reset", "count"],
    runtime: Path | None,
    config: Path | None,
    as_json: bool,
    trolley: int = 1,
    confirmed: bool = False,
) -> NoReturn:
    request = LockRequest(request_id(), round(_TRAVEL_S * 1000), action, trolley, confirmed)
    with answering(as_json), open_link(runtime, config) as link:
        answer = link.ask(LOCK_REQUEST, request, _TRAVEL_S)
    say(answer.outcome, answer.reason, as_json)
