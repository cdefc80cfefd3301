"""``davpc processes``: the table of the runtime's processes."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Annotated

import typer

from common.processes import PROCESSES

table = typer.Typer()


@table.command(epilog="Example:  davpc processes --json")
def processes(
    as_json: Annotated[bool, typer.Option("--json", help="one JSON object for programs")] = False,
) -> None:
    """List the processes of the runtime. `davpc processes`"""
    if as_json:
        typer.echo(json.dumps({"processes": [asdict(entry) for entry in PROCESSES]}, ensure_ascii=False))
        return
    for entry in PROCESSES:
        when = f"{entry.rate_hz:.0f} Hz by {entry.stepped_by}"
        typer.echo(f"{entry.name:20s} {entry.robot:9s} FIFO {entry.priority}  {when:36s} {entry.purpose}")
