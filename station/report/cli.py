"""``davpc report``: what happened in a docking, why it ended, what to do."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from common.errors import ConfigError, DeviceError
from common.recording.recording import Recording
from station.operate.attempts import ATTEMPTS_FILE, Record, biases, read_attempts
from station.operate.link import running_robot
from station.options import writable
from station.report.attempt import RecordedAttempt
from station.report.explanation import evidence, headline

INSTALLED = Path("/var/lib/davpc")
FOLDER = "recordings"
_OTHERS = 20
report_app = typer.Typer()


@report_app.command("report", epilog="Example:  davpc report last --html out/report.html")
def report(
    file: Annotated[str, typer.Argument(help="recording, or `last`: the newest of the robot that runs here")],
    html: Annotated[
        Path | None, typer.Option(callback=lambda out: out and writable(out), help="page to write")
    ] = None,
    against: Annotated[Path | None, typer.Option(help="recording to compare it with")] = None,
    state: Annotated[
        Path | None, typer.Option(help="folder with the attempts' reports", show_default="the robot's")
    ] = None,
) -> None:
    """Explain a recorded docking. `davpc report last`"""
    path = newest(state) if file == "last" else Path(file)
    attempt = RecordedAttempt(Recording.read(path))
    other = None if against is None else RecordedAttempt(Recording.read(against))
    earlier = _earlier(state or (path.parent.parent if path.parent.name == FOLDER else path.parent))
    for line in (*headline(attempt), *(f"- {line}" for line in evidence(attempt)), *biases(earlier)):
        typer.echo(line)
    if html is None:
        return
    try:
        from station.report.page import page  # noqa: PLC0415 - it needs matplotlib, which is optional
    except ModuleNotFoundError as error:
        raise ConfigError(f"--html draws with {error.name}: pip install 'davpc[plot,record]'") from error
    html.write_text(page(attempt, other, earlier), encoding="utf-8")
    typer.echo(f"written: {html}")


def newest(state: Path | None) -> Path:
    """The newest recording in the folder of the robot's state.

    Raises:
        ConfigError: there is none.
    """
    if state is None:
        try:
            state = INSTALLED if INSTALLED.is_dir() else running_robot(None)
        except DeviceError as error:
            raise ConfigError(f"{error}; or name the folder of its state with --state") from error
    found = [path for path in (state / FOLDER).glob("*.mcap") if not path.name.endswith(".frames.mcap")]
    if not found:
        raise ConfigError(f"{state / FOLDER}: no recordings")
    return max(found, key=lambda path: (path.stat().st_mtime_ns, path.name))


def _earlier(folder: Path) -> list[Record]:
    """The attempts before it; none where there are no reports."""
    try:
        return read_attempts(folder / ATTEMPTS_FILE, _OTHERS)[0]
    except ConfigError:
        return []
