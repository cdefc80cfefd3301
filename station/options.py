"""Options and small parsers that several commands share."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from common.config import Config, default_config_path, load_config
from common.errors import ConfigError

EXIT_MISSED = 1
# where an installed robot has its sockets and frames
ROBOT = Path("/run/davpc")
ConfigOption = Annotated[
    Path | None,
    typer.Option("--config", envvar="DAVPC_CONFIG", help="TOML file of the pair", show_default="reference"),
]
SetOption = Annotated[
    list[str] | None, typer.Option("--set", envvar="DAVPC_SET", help="override, as table.key=value; repeatable")
]
SeedOption = Annotated[int, typer.Option(min=0, help="random seed")]
JobsOption = Annotated[int, typer.Option(min=1, help="processes to share the work")]
CORES = os.cpu_count() or 1
ClusterOption = Annotated[
    str,
    typer.Option(
        envvar="DAVPC_CLUSTER",
        help="dask.distributed scheduler, as tcp://HOST:8786, whose workers do the runs instead; see docs/cluster.md",
    ),
]
MethodsOption = Annotated[str, typer.Option(help="comma-separated; the usual ones when empty")]
CasesOption = Annotated[str, typer.Option(help="comma-separated; all when empty")]
RuntimeOption = Annotated[
    Path | None,
    typer.Option(
        "--runtime", help="folder of the running robot's sockets and frames", show_default="the robot that runs here"
    ),
]
FramesOption = Annotated[
    Literal["pictures", "all"], typer.Option(help="all: keep every frame too, without loss, 25 MB a second")
]
JsonOption = Annotated[bool, typer.Option("--json", help="one JSON object for programs")]


def loaded(config: Path | None, overrides: list[str] | None) -> Config:
    """The configuration that the options name."""
    return load_config(config or default_config_path(), overrides or [])


def numbers(text: str, count: int) -> tuple[float, ...]:
    """Comma-separated numbers.

    Raises:
        ConfigError: not ``count`` finite numbers.
    """
    try:
        parsed = tuple(float(part) for part in text.split(","))
    except ValueError:
        parsed = ()
    if len(parsed) != count or not all(map(math.isfinite, parsed)):
        raise ConfigError(f"{text!r}: write {count} numbers with commas, such as 6,1.5,0")
    return parsed


def writable(out: Path) -> Path:
    """A file that can be written, asked before the work that fills it.

    Raises:
        ConfigError: its folder is missing or closed, or it is a folder itself.
    """
    folder = out.absolute().parent
    if not folder.is_dir():
        raise ConfigError(f"{out}: cannot be written: no folder {folder}")
    if out.is_dir() or not os.access(out if out.exists() else folder, os.W_OK):
        raise ConfigError(f"{out}: cannot be written: {'a folder' if out.is_dir() else 'no permission'}")
    return out


def results_folder(out: Path) -> Path:
    """A folder for results, made before the hours of work that fill it.

    Raises:
        ConfigError: it cannot be made or written to.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"--out {out}: cannot be written to: {error.strerror}") from error
    if not os.access(out, os.W_OK | os.X_OK):
        raise ConfigError(f"--out {out}: cannot be written to: no permission")
    return out


OutOption = Annotated[Path, typer.Option(callback=results_folder, help="folder for the results; made if missing")]


def names(text: str, known: tuple[str, ...], what: str) -> tuple[str, ...]:
    """Comma-separated names out of ``known``; all of them for an empty text.

    Raises:
        ConfigError: a name is not among them.
    """
    wanted = tuple(name.strip() for name in text.split(",") if name.strip()) or known
    for name in wanted:
        if name not in known:
            raise ConfigError(f"no {what} {name!r}; there are: {', '.join(known)}")
    return wanted


def show(out: Path) -> None:
    """Print the table that an experiment wrote, and where its files are."""
    for table in sorted(out.glob("*.md")):
        typer.echo(table.read_text(encoding="utf-8"))
    typer.echo(f"written: {', '.join(str(path) for path in sorted(out.iterdir()) if path.is_file())}")


def judge(out: Path, results: dict[str, Any]) -> None:
    """Show the results; exit code 1 where a run did not end as it must."""
    show(out)
    if results["settings"]["missed"]:
        raise typer.Exit(EXIT_MISSED)
