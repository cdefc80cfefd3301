"""How commands that ask a running robot answer: one clear line, or one JSON object, and exit code 0 or 1."""

from __future__ import annotations

import contextlib
import json
import secrets
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any, NoReturn

import typer

from common.errors import DeviceError
from station.operate.link import RobotLink, running_robot
from station.options import loaded

PATIENCE_S = 5.0


def request_id() -> str:
    """An id that no other request has."""
    return f"operator-{secrets.token_hex(6)}"


def say(outcome: str, reason: str, as_json: bool) -> NoReturn:
    """Show what became of a request, and exit."""
    good = outcome in ("done", "accepted")
    if as_json:
        show_json({"outcome": outcome, "reason": reason})
    else:
        typer.echo(f"{outcome}: {reason}", err=not good)
    raise typer.Exit(0 if good else 1)


def show_json(table: dict[str, Any]) -> None:
    """One line."""
    typer.echo(json.dumps(table, ensure_ascii=False))


def fields(message: Any) -> dict[str, Any] | None:
    """A message as a table; None where none was received."""
    return None if message is None else asdict(message)


@contextlib.contextmanager
def answering(as_json: bool) -> Iterator[None]:
    """A robot that does not run or answer is a line and exit code 1."""
    try:
        yield
    except DeviceError as error:
        if as_json:
            show_json({"outcome": "unreachable", "reason": str(error)})
        else:
            typer.echo(f"davpc: {error}", err=True)
        raise typer.Exit(1) from error


@contextlib.contextmanager
def open_link(runtime: Path | None, config: Path | None) -> Iterator[RobotLink]:
    """A connection to the robot that runs here, or in the named folder.

    Raises:
        DeviceError: none runs here, or several.
        ConfigError: a configuration that cannot be read.
    """
    with RobotLink(running_robot(runtime), namespace(config)) as link:
        yield link


def namespace(config: Path | None) -> str:
    """The Zenoh namespace of the pair."""
    return loaded(config, None).network.namespace
