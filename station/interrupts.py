"""Ctrl-C and its like, for commands that have to take something down in order."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import typer

_STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
EXIT_INTERRUPTED = 130


@contextlib.contextmanager
def interruptible() -> Iterator[Callable[[], bool]]:
    """Ctrl-C, SIGTERM and a closed terminal set a flag, so that everything is taken down in order."""
    seen: list[int] = []
    before = {number: signal.signal(number, lambda n, _: seen.append(n)) for number in _STOP_SIGNALS}
    try:
        yield lambda: bool(seen)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def resumable(out: Path) -> Iterator[None]:
    """Around an experiment that keeps what is done in ``out``: an interrupt is one line, and exit code 130."""
    before = {number: signal.signal(number, signal.default_int_handler) for number in _STOP_SIGNALS}
    try:
        yield
    except KeyboardInterrupt as error:
        typer.echo(f"davpc: interrupted; the same command goes on from what is done in {out}", err=True)
        raise typer.Exit(EXIT_INTERRUPTED) from error
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
