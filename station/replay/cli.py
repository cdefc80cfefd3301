"""``davpc replay``: what a node makes of recorded inputs, now or with another setting."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from common.config import Config, default_config_path, with_overrides
from common.errors import ConfigError
from common.files.writer import write_json
from common.recording.recording import Recording
from common.recording.run import versions
from station.interrupts import interruptible
from station.options import names, results_folder
from station.replay.compare import judge
from station.replay.core import CORES
from station.replay.publish import publish
from station.replay.what_if import FieldTrace, as_table, chosen_overrides, side_by_side

EXIT_DIFFERENT = 1
replay_app = typer.Typer()


@replay_app.command("replay", epilog="Example:  davpc replay out/run3/run.mcap --core controller")
def replay(
    file: Annotated[Path, typer.Argument(help="recording")],
    core: Annotated[str, typer.Option(help=f"comma-separated: {', '.join(CORES)}; all when empty")] = "",
    fresh: Annotated[
        bool, typer.Option("--fresh", help="begin as after a start, not with the recorded state")
    ] = False,
    method: Annotated[
        str, typer.Option(help="compare with another method: davpc, paper, paper_fatrop, paper_ipopt")
    ] = "",
    overrides: Annotated[
        list[str] | None, typer.Option("--set", help="compare with another setting, table.key=value; repeatable")
    ] = None,
    onto: Annotated[
        Path | None, typer.Option("--publish", help="folder of a mesh without a robot: publish there instead")
    ] = None,
    speed: Annotated[float, typer.Option(min=0.01, max=100.0, help="with --publish")] = 1.0,
    out: Annotated[Path, typer.Option(help="with --method or --set: folder for table and picture")] = Path(
        "out/replay"
    ),
) -> None:
    """Replay recorded inputs through a node's own step. `davpc replay run.mcap`"""
    recording = Recording.read(file)
    for line in warnings(recording):
        typer.echo(line, err=True)
    if onto is not None:
        _publish(recording, onto, speed)
        return
    changes = chosen_overrides(method, overrides or [])
    config = with_overrides(recording.config, changes, str(file)) if changes else recording.config
    if changes and not core:
        _compare(recording, config, method or " ".join(overrides or ()), results_folder(out))
        return
    cores = names(core, tuple(CORES), "core")
    if not core and not recording.frames.there:
        typer.echo("estimator: left out, the frames are not recorded (davpc sim --frames all)")
        cores = tuple(name for name in cores if name != "estimator")
    # a recorded state holds the settings that it was recorded with
    if not _identical(recording, cores, config, fresh=fresh or bool(changes)):
        raise typer.Exit(EXIT_DIFFERENT)


def warnings(recording: Recording) -> list[str]:
    """What may keep a replay from being exact or complete."""
    lines = [f"{recording.path}: ends too early: {recording.torn}"] if recording.torn else []
    lines += [f"{recording.path}: {count} of {name} dropped" for name, count in recording.dropped.items()]
    for name, version in versions().items():
        then = recording.about.get(name)
        if then != version:
            lines.append(f"{recording.path}: recorded with {name} {then}, this is {version}: it may differ")
    return lines


def _identical(recording: Recording, cores: Sequence[str], config: Config, *, fresh: bool) -> bool:
    same = True
    for name in cores:
        verdict = judge(name, recording, config, default_config_path(), fresh=fresh)
        typer.echo("\n".join(verdict.summary()))
        same = same and verdict.identical
    return same


def _publish(recording: Recording, runtime: Path, speed: float) -> None:
    if not runtime.is_dir():
        raise ConfigError(f"--publish {runtime}: no such folder: make it with mode 0700")
    with interruptible() as interrupted:
        count = publish(recording, runtime, recording.config.network.namespace, speed, interrupted)
    typer.echo(f"{count} messages published")


def _compare(recording: Recording, config: Config, label: str, out: Path) -> None:
    traces = side_by_side(recording, config, default_config_path())
    if not recording.frames.there:
        typer.echo("the estimator is left out: the frames are not recorded (davpc sim --frames all)")
    table = as_table(traces)
    (out / "replay.md").write_text(table, encoding="utf-8")
    write_json(out / "results.json", {"file": str(recording.path), "other": label, "rows": [t.row() for t in traces]})
    typer.echo(f"recorded beside {label}\n\n{table}")
    written = [out / "replay.md", out / "results.json", *_drawn(traces, label, out)]
    typer.echo(f"written: {', '.join(map(str, written))}")


def _drawn(traces: list[FieldTrace], label: str, out: Path) -> list[Path]:
    """The picture, where matplotlib is installed."""
    try:
        from station.replay import figures  # noqa: PLC0415 - it needs matplotlib, which is optional
    except ModuleNotFoundError:
        return []
    return [figures.draw(traces, label, out / "replay.png")]
