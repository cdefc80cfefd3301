"""The command line: ``davpc --help`` shows every command with an example.

Only the room of the command that is named gets imported; ``--help`` imports them all.
"""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import suppress
from importlib import import_module, metadata
from typing import Annotated, Any, cast

import typer
from typer.core import TyperGroup
from typer.main import get_group

from common.errors import ConfigError, DeviceError

EXIT_CONFIG = 2
EXIT_DEVICE = 3
# panel of the help → command → ``module:typer``; the Typer holds a command of that name, or is the group itself
COMMANDS = {
    "Simulate and measure": {
        "sim": "station.simulate.cli:simulate",
        "experiment": "station.experiment:experiment",
        "bench": "station.bench:bench",
    },
    "Record and replay": {
        "record": "station.export.cli_record:record_app",
        "report": "station.report.cli:report_app",
        "replay": "station.replay.cli:replay_app",
        "trace": "station.export.cli:trace_app",
        "export": "station.export.cli:tables_app",
    },
    "Operate robots": {
        "dock": "station.operate.cli_dock:dock",
        "led": "station.operate.cli_leader:led",
        "lock": "station.operate.cli_leader:lock",
        "jog": "station.operate.cli_manual:manual",
        "grip": "station.operate.cli_manual:manual",
        "lift": "station.operate.cli_manual:manual",
        "doctor": "station.doctor.cli:examine",
    },
    "Bring a robot up": {
        "wiring": "station.commission.cli_wiring:wire",
        "can": "station.commission.cli_can:can",
        "network": "station.commission.cli_network:network",
        "camera": "station.calibrate.cli_camera:camera",
        "calibrate": "station.calibrate.cli:calibrate",
        "teach": "station.calibrate.cli_camera:taught",
    },
    "Run processes": {
        "run": "station.operate.cli_run:start",
        "processes": "station.operate.cli_processes:table",
    },
}


class _LazyCommands(Mapping[str, Any]):
    """The commands by name, each imported when it is asked for."""

    def __init__(self) -> None:
        self._places = {name: (panel, place) for panel, names in COMMANDS.items() for name, place in names.items()}

    def __getitem__(self, name: str) -> Any:
        panel, place = self._places[name]
        module, _, attribute = place.partition(":")
        group = get_group(getattr(import_module(module), attribute))
        command: Any = group.commands.get(name, group)
        command.name, command.rich_help_panel = name, panel
        return command

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)


class _LazyGroup(TyperGroup):
    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands = cast(Any, _LazyCommands())


app = typer.Typer(
    cls=_LazyGroup,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    help="Two robots dock luggage trolleys by vision: run them, simulate them, measure them.",
    epilog="A first docking, simulated down to pixels and CAN frames:  [bold]davpc sim[/]",
)


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"davpc {metadata.version('davpc')}")
        raise typer.Exit


@app.callback()
def davpc(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """What every command has in common: nothing but ``--version``."""


def main() -> None:
    """Entry point: a user's mistake is one line and exit code 2, a device's failure one line and 3."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a terminal without Ω shows a question mark in its place
            stream.reconfigure(errors="replace")
    code: str | int | None = 0
    try:
        app()
    except SystemExit as end:
        code = end.code
    except ConfigError as error:
        code = _fail(str(error), EXIT_CONFIG)
    except DeviceError as error:
        code = _fail(str(error), EXIT_DEVICE)
    except OSError as error:  # a disk that is full, broken or read-only
        code = _fail(f"{error.filename or 'output'}: cannot be written: {error.strerror}", EXIT_CONFIG)
    try:
        sys.stdout.flush()
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or the interpreter fails at it once more
        code = _fail(f"output: cannot be written: {error.strerror}", EXIT_CONFIG)
    sys.exit(code)


def _fail(text: str, code: int) -> int:
    """The one line of a failure; the exit code."""
    with suppress(OSError):
        typer.echo(f"davpc: {text}", err=True)
    return code


if __name__ == "__main__":
    main()
