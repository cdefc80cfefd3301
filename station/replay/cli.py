"""``davpc replay``: what a node makes of recorded inputs, now or with another setting."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from common.config import default_config_path
from common.recording.recording import Recording
from station.options import names
from station.replay.compare import judge
from station.replay.core import CORES

EXIT_DIFFERENT = 1
replay_app = typer.Typer()


@replay_app.command("replay", epilog="Example:  davpc replay out/run3/run.mcap --core controller")
def replay(
    file: Annotated[Path, typer.Argument(help="recording")],
    core: Annotated[
        str, typer.Option(help=f"comma-separated: {', '.join(CORES)}; all that the file allows when empty")
    ] = "",
    fresh: Annotated[
        bool, typer.Option("--fresh", help="begin as after a start, not with the recorded state")
    ] = False,
) -> None:
    """Replay recorded inputs through a node's own step. `davpc replay run.mcap`"""
    recording = Recording.read(file)
    if recording.torn:
        typer.echo(f"{file}: ends too early: {recording.torn}")
    for name, count in recording.dropped.items():
        typer.echo(f"{file}: {count} messages of {name} were dropped by the recorder")
    same = True
    for name in names(core, tuple(CORES), "core"):
        verdict = judge(name, recording, recording.config, default_config_path(), fresh=fresh)
        typer.echo("\n".join(verdict.summary()))
        same = same and verdict.identical
    if not same:
        raise typer.Exit(EXIT_DIFFERENT)
