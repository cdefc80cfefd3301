"""``davpc jog``, ``grip``, ``lift``: a running robot moved by hand, hold-to-run and through the gate."""

from __future__ import annotations

import contextlib
import os
import select
import sys
import termios
import tty
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated, Literal

import typer

from common.errors import DeviceError
from station.interrupts import interruptible
from station.operate.answers import namespace
from station.operate.link import running_robot
from station.operate.manual import Fingers, Keys, ManualFeedback, ManualLink
from station.options import ConfigOption, RuntimeOption

manual = typer.Typer()

_LIFT_TOLERANCE_M = 0.0005


@manual.command(epilog="Example:  davpc jog --speed 0.05 --seconds 2")
def jog(
    speed: Annotated[float, typer.Option(min=-0.1, max=0.1, help="m/s, negative backwards")] = 0.0,
    turn: Annotated[float, typer.Option(min=-0.3, max=0.3, help="rad/s, to the left")] = 0.0,
    seconds: Annotated[float, typer.Option(min=0, help="0: until Ctrl-C")] = 0,
    runtime: RuntimeOption = None,
    config: ConfigOption = None,
) -> None:
    """Move the robot by hand, through the gate. `davpc jog`

    With neither --speed nor --turn by the arrow keys, for as long as one is held.
    """
    by_keys = not speed and not turn
    if by_keys and not sys.stdin.isatty():
        raise typer.BadParameter("give --speed or --turn, or hold arrow keys at a terminal")
    with interruptible() as released, _open(runtime, config) as link, _keyboard(by_keys) as typed:
        keys = Keys(0.05, 0.2)
        since_ns: list[int] = []

        def steer(feedback: ManualFeedback) -> tuple[float, float] | None:
            if not since_ns:
                since_ns.append(feedback.now_ns)
                typer.echo("armed: hold an arrow key to move, q ends" if by_keys else "moving; Ctrl-C stops")
            if released() or (seconds and feedback.now_ns - since_ns[0] >= seconds * 1e9):
                return None
            if not by_keys:
                return speed, turn
            strokes = typed()
            return None if strokes.endswith("q") else keys.step(feedback.now_ns, strokes)

        _end(link.hold(steer), released)


@manual.command(epilog="Example:  davpc grip close")
def grip(
    action: Annotated[Literal["open", "close"], typer.Argument(help="what the fingers do; the arms stay")],
    runtime: RuntimeOption = None,
    config: ConfigOption = None,
) -> None:
    """Open or close both grippers. `davpc grip open`

    Ctrl-C stops them where they are.
    """
    wanted: Literal["open", "closed"] = "open" if action == "open" else "closed"
    fingers = Fingers(wanted)
    last: list[ManualFeedback] = []

    def steer(feedback: ManualFeedback) -> tuple[float, float] | None:
        last[:] = [feedback]
        return None if released() else fingers.step(feedback)

    with interruptible() as released, _open(runtime, config) as link:
        _end(link.hold(steer, grip=wanted), released)
    arms = last[0].arms if last else None
    state = "open" if arms and arms.released else "hold something" if arms and arms.gripped else "hold nothing"
    typer.echo(f"grippers {state}")
    if arms is None or (action == "open") != arms.released:
        raise typer.Exit(1)


@manual.command(epilog="Example:  davpc lift 200")
def lift(
    height_mm: Annotated[float, typer.Argument(metavar="MM", min=0, max=1000, help="above its lowest position")],
    runtime: RuntimeOption = None,
    config: ConfigOption = None,
) -> None:
    """Move the lift to a height. `davpc lift 200`

    Ctrl-C stops it where it is.
    """
    wanted_m = height_mm / 1000.0
    reached: list[float] = []

    def steer(feedback: ManualFeedback) -> tuple[float, float] | None:
        if feedback.drives is not None:
            reached[:] = [feedback.drives.lift_m]
        there = bool(reached) and abs(reached[0] - wanted_m) <= _LIFT_TOLERANCE_M
        return None if there or released() else (0.0, 0.0)

    with interruptible() as released, _open(runtime, config) as link:
        _end(link.hold(steer, lift_m=wanted_m), released)
    typer.echo(f"lift at {1000.0 * reached[0]:.1f} mm" if reached else "the lift did not move")
    if not reached or abs(reached[0] - wanted_m) > _LIFT_TOLERANCE_M:
        raise typer.Exit(1)


def _open(runtime: Path | None, config: Path | None) -> ManualLink:
    """The connection to the robot that runs here, or in the named folder."""
    return ManualLink(running_robot(runtime), namespace(config))


def _end(cause: str, released: Callable[[], bool]) -> None:
    if cause:
        raise DeviceError(f"stopped: {cause}")
    typer.echo("released" if released() else "done")


@contextlib.contextmanager
def _keyboard(wanted: bool) -> Iterator[Callable[[], str]]:
    """What was typed since the last call, without waiting for a line to end; the terminal is put back afterwards."""
    if not wanted:
        yield lambda: ""
        return
    terminal = sys.stdin.fileno()
    before = termios.tcgetattr(terminal)

    def typed() -> str:
        ready = select.select([terminal], [], [], 0)[0]
        return os.read(terminal, 64).decode("ascii", "replace") if ready else ""

    tty.setcbreak(terminal)
    try:
        yield typed
    finally:
        termios.tcsetattr(terminal, termios.TCSADRAIN, before)
