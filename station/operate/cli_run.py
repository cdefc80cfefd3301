"""``davpc run``: one process of the runtime, as the units and ``davpc sim`` start it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from common.config import default_config_path
from common.errors import ConfigError
from common.executor import run_process
from common.processes import PROCESSES, process
from station.options import ROBOT, ConfigOption, SetOption

start = typer.Typer()


@start.command(epilog="Example:  davpc run follower-camera --runtime /run/davpc")
def run(
    name: Annotated[str, typer.Argument(help=f"one of {', '.join(p.name for p in PROCESSES)}")],
    runtime: Annotated[Path, typer.Option(help="private folder of the robot's sockets and frames")] = ROBOT,
    shadow: Annotated[
        bool, typer.Option("--shadow", help="the CAN bridge never enables a drive and reports what it would command")
    ] = False,
    readonly: Annotated[
        bool,
        typer.Option("--readonly", help="the CAN bridge sends nothing and reports what another master's drives do"),
    ] = False,
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Run one process of the runtime. `davpc run leader`"""
    try:
        process(name)
    except KeyError as error:
        raise ConfigError(str(error.args[0])) from error
    if not runtime.is_dir():
        raise ConfigError(f"{runtime}: no such folder; make it with mode 0700, or let systemd do so")
    modes = {"shadow": shadow, "readonly": readonly}
    chosen = [*(overrides or []), *(f"follower_can.{mode}=true" for mode, wanted in modes.items() if wanted)]
    raise typer.Exit(run_process(name, config or default_config_path(), runtime, chosen))
