"""``davpc led`` and ``davpc lock``: the Leader's array and lock, of running robots, real or simulated."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, NoReturn

import typer

from common.channels import LEADER_STATE, LED_REQUEST, LOCK_REQUEST
from common.messages import LeaderState, LedRequest, LockRequest
from station.operate.answers import (
    PATIENCE_S,
    JsonOption,
    RunningOption,
    answering,
    fields,
    open_link,
    request_id,
    say,
    show_json,
)
from station.operate.cli_dock import leader_line

led = typer.Typer(no_args_is_help=True, help="The Leader's LEDs. `davpc led status`")
lock = typer.Typer(no_args_is_help=True, help="The Leader's guide and lock. `davpc lock status`")
YesOption = Annotated[bool, typer.Option("--yes", help="confirm without being asked")]
# a lock that travels answers when it is there: jam, retraction and all
_TRAVEL_S = 15.0


@led.command("set", epilog="Example:  davpc led set 0.8 --led 2")
def led_set(
    current: Annotated[str, typer.Argument(help="amperes, off, or on: as configured")],
    number: Annotated[int | None, typer.Option("--led", min=0, max=11, help="which one", show_default="all")] = None,
    runtime: RunningOption = None,
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
    with answering(as_json), open_link(runtime) as link:
        answer = link.ask(LED_REQUEST, request, PATIENCE_S)
    say(answer.outcome, answer.reason, as_json)


@led.command("status", epilog="Example:  davpc led status")
def led_status(runtime: RunningOption = None, as_json: JsonOption = False) -> None:
    """What each LED is told and draws."""
    leader = _heard(runtime, as_json)
    if as_json:
        show_json(fields(leader) or {})
    else:
        for number, drawn in enumerate(leader.led_current_a):
            told = leader.led_setpoint_a[number] if number < len(leader.led_setpoint_a) else 0.0
            typer.echo(f"LED {number}: told {told:.2f} A, draws {drawn:.2f} A")
        typer.echo(f"Leader: {leader_line(leader)}")
    raise typer.Exit(1 if leader.led_fault else 0)


@lock.command("status", epilog="Example:  davpc lock status")
def lock_status(runtime: RunningOption = None, as_json: JsonOption = False) -> None:
    """Where the lock is, and how many trolleys stand behind it."""
    leader = _heard(runtime, as_json)
    if as_json:
        show_json(fields(leader) or {})
    else:
        typer.echo(f"Leader: {leader_line(leader)}")
    raise typer.Exit(1 if leader.lock == "fault" else 0)


@lock.command("close", epilog="Example:  davpc lock close")
def lock_close(runtime: RunningOption = None, as_json: JsonOption = False) -> None:
    """Close the lock behind a beam that is in its seat."""
    _ask("lock", runtime, as_json)


@lock.command("open", epilog="Example:  davpc lock open --yes")
def lock_open(yes: YesOption = False, runtime: RunningOption = None, as_json: JsonOption = False) -> None:
    """Let the queue go: asks first, and never while the Follower moves or holds a trolley against it."""
    confirmed = yes or _sure("the whole queue is let go: sure?", as_json)
    _ask("unlock", runtime, as_json, confirmed=confirmed)


@lock.command("reset", epilog="Example:  davpc lock reset --yes")
def lock_reset(yes: YesOption = False, runtime: RunningOption = None, as_json: JsonOption = False) -> None:
    """Clear a lock fault after a person has looked; with --yes a bolt that is half way is retracted."""
    _ask("reset", runtime, as_json, confirmed=yes)


@lock.command("count", epilog="Example:  davpc lock count 3 --yes")
def lock_count(
    trolleys: Annotated[int, typer.Argument(min=0, max=99, help="that stand locked in the queue")],
    yes: YesOption = False,
    runtime: RunningOption = None,
    as_json: JsonOption = False,
) -> None:
    """Say how many trolleys stand in the queue, where the Leader does not know."""
    confirmed = yes or _sure(f"{trolleys} trolleys stand in the queue: sure?", as_json)
    _ask("count", runtime, as_json, trolleys, confirmed)


def _heard(runtime: Path | None, as_json: bool) -> LeaderState:
    with answering(as_json), open_link(runtime) as link:
        watch = link.watch(LEADER_STATE)
        watch.wait(3.0)
        leader = watch.newest(LEADER_STATE)
    if leader is None:
        say("unreachable", "the Leader is not heard", as_json)
    return leader


def _sure(question: str, as_json: bool) -> bool:
    """A person's word at a terminal; a program confirms with --yes."""
    if as_json:
        return False
    try:
        return typer.confirm(question)
    except typer.Abort:
        return False


def _ask(
    action: Literal["lock", "unlock", "reset", "count"],
    runtime: Path | None,
    as_json: bool,
    trolley: int = 1,
    confirmed: bool = False,
) -> NoReturn:
    request = LockRequest(request_id(), round(_TRAVEL_S * 1000), action, trolley, confirmed)
    with answering(as_json), open_link(runtime) as link:
        answer = link.ask(LOCK_REQUEST, request, _TRAVEL_S)
    say(answer.outcome, answer.reason, as_json)
