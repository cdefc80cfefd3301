"""``davpc sim``: dock simulated trolleys, one process each or in stepped time, and show what came out."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from common.config import default_config_path
from common.errors import ConfigError
from common.processes import ONE_MACHINE, PROCESSES
from sim.optics.scenes import SCENES
from sim.world_config import WorldConfig
from station.options import ConfigOption, FramesOption, SetOption, numbers
from station.simulate import report
from station.simulate.processes import run_attached, run_processes
from station.simulate.progress import live_progress
from station.simulate.record import DockingRecord
from station.simulate.run import Run
from station.simulate.stepped import run_stepped

EXIT_NOT_DOCKED = 1

simulate = typer.Typer()


@simulate.command(epilog="Example:  davpc sim --start 6,1.5,0 --seed 3 --out out/run3")
def sim(
    seed: Annotated[int | None, typer.Option(min=0, help="random seed", show_default="configuration: 1")] = None,
    start: Annotated[
        str | None,
        typer.Option(help="metres behind the Leader, metres left, degrees", show_default="configuration: 6,1.5,0"),
    ] = None,
    scene: Annotated[
        str | None,
        typer.Option(
            help=", ".join(name for name in SCENES if name != "clean"),
            show_default="configuration: clean",
        ),
    ] = None,
    trolleys: Annotated[int, typer.Option(min=1, max=30, help="to dock in a row")] = 1,
    stepped: Annotated[
        bool, typer.Option(help="one process, stepped time: deterministic, faster than real time")
    ] = False,
    headless: Annotated[bool, typer.Option(help="plain lines instead of live progress")] = False,
    attach: Annotated[
        Path | None, typer.Option(help="folder of a Follower's sockets: dock with the processes that run there")
    ] = None,
    record: Annotated[bool, typer.Option("--record", help="leave run.mcap in --out, for davpc replay")] = False,
    frames: FramesOption = "pictures",
    out: Annotated[Path, typer.Option(help="folder for results.json, pictures and logs")] = Path("out/sim"),
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Dock one trolley, or a queue, with both robots, simulated. `davpc sim --trolleys 8`"""
    draw = _drawing(required=attach is None)
    console = Console(force_terminal=False if headless else None, highlight=False)
    chosen = [*(overrides or []), *_world_overrides(seed, start, scene)]
    run = Run(
        config or default_config_path(),
        chosen,
        out,
        trolleys,
        record=record or frames == "all",
        frames=frames == "all",
    )
    world = run.world
    x_m, y_m, theta_deg = world.start
    console.print(
        f"docking from {x_m:g},{y_m:g},{theta_deg:g} in scene {world.scene}, seed {world.seed}, "
        + ("stepped" if stepped else f"{len(PROCESSES if attach else ONE_MACHINE)} processes")
    )
    with live_progress(console) as run.progress:
        if attach is not None:
            done = run_attached(run, attach)
        else:
            done = run_stepped(run) if stepped else run_processes(run)
    results = report.write_results(
        done.records, done.cause, done.memory_mb, _settings(world, stepped, trolleys, overrides), out
    )
    drawn = draw(done.records, out)
    report.print_results(results, console)
    written = [out / "results.json", *drawn, *sorted(out.glob("run*.mcap"))]
    console.print(f"written: {', '.join(map(str, written))}", soft_wrap=True)
    if not results["connected"]:
        raise typer.Exit(EXIT_NOT_DOCKED)


def _settings(world: WorldConfig, stepped: bool, trolleys: int, overrides: list[str] | None) -> dict[str, Any]:
    """What was run, for the results."""
    return {
        "seed": world.seed,
        "start": list(world.start),
        "scene": world.scene,
        "stepped": stepped,
        "trolleys": trolleys,
        "overrides": overrides or [],
    }


def _world_overrides(seed: int | None, start: str | None, scene: str | None) -> list[str]:
    """Options of the simulated world as overrides of the configuration."""
    chosen = {
        "seed": seed,
        "start": None if start is None else list(numbers(start, 3)),
        "scene": None if scene is None else json.dumps(scene),
    }
    return [f"world.{key}={value}" for key, value in chosen.items() if value is not None]


def _drawing(required: bool) -> Callable[[Sequence[DockingRecord], Path], list[Path]]:
    """What draws the pictures; nothing does, unless required, where matplotlib is not installed: on a robot."""
    try:
        from station.simulate import figures  # noqa: PLC0415 - it needs matplotlib, which is optional
    except ModuleNotFoundError as error:
        if required:
            raise ConfigError(f"davpc sim draws pictures with {error.name}: pip install 'davpc[plot]'") from error
        return lambda _records, _out: []
    return figures.draw_all
