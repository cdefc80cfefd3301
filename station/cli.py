"""The command line: ``davpc --help`` shows every command with an example."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from common.config import default_config_path
from common.errors import ConfigError, DeviceError
from common.processes import ONE_MACHINE, PROCESSES, process
from station import experiment as cli_experiment
from station.calibrate import cli as cli_calibrate
from station.calibrate import cli_camera
from station.commission import cli_can, cli_network
from station.doctor import cli as cli_doctor
from station.operate import cli_dock, cli_leader, cli_manual
from station.options import ConfigOption, SetOption, numbers

if TYPE_CHECKING:
    from station.simulate.record import DockingRecord

EXIT_NOT_DOCKED = 1
EXIT_CONFIG = 2
EXIT_DEVICE = 3

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    help="Two robots dock luggage trolleys by vision: run them, simulate them, measure them.",
    epilog="A first docking, simulated down to pixels and CAN frames:  [bold]davpc sim[/]",
)


@app.command(epilog="Example:  davpc sim --start 6,1.5,0 --seed 3 --out out/run3")
def sim(
    seed: Annotated[
        int | None, typer.Option(min=0, help="of all that is random", show_default="configuration: 1")
    ] = None,
    start: Annotated[
        str | None,
        typer.Option(help="metres behind the Leader, metres left, degrees", show_default="configuration: 6,1.5,0"),
    ] = None,
    scene: Annotated[
        str | None,
        typer.Option(
            help="dark_outdoor, parking_lot, glass_hall, clutter40, blocked, dead_led, second_leader",
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
    out: Annotated[Path, typer.Option(help="folder for results.json, pictures and logs")] = Path("out/sim"),
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Dock one trolley, or a queue, with both robots, simulated. `davpc sim --trolleys 8`"""
    from rich.console import Console

    from station.simulate import report
    from station.simulate.processes import run_attached, run_processes
    from station.simulate.progress import live_progress
    from station.simulate.run import Run
    from station.simulate.stepped import run_stepped

    draw = _drawing(required=attach is None)
    console = Console(force_terminal=False if headless else None, highlight=False)
    chosen = list(overrides or [])
    if seed is not None:
        chosen.append(f"world.seed={seed}")
    if start is not None:
        chosen.append(f"world.start={list(numbers(start, 3))}")
    if scene is not None:
        chosen.append(f"world.scene={json.dumps(scene)}")
    chosen_run = Run(config or default_config_path(), chosen, out, trolleys)
    world = chosen_run.world
    x_m, y_m, theta_deg = world.start
    console.print(
        f"docking from {x_m:g},{y_m:g},{theta_deg:g} in scene {world.scene}, seed {world.seed}, "
        + ("stepped" if stepped else f"{len(PROCESSES if attach else ONE_MACHINE)} processes")
    )
    with live_progress(console) as chosen_run.progress:
        if attach is not None:
            done = run_attached(chosen_run, attach)
        else:
            done = run_stepped(chosen_run) if stepped else run_processes(chosen_run)
    settings = {
        "seed": world.seed,
        "start": list(world.start),
        "scene": world.scene,
        "stepped": stepped,
        "trolleys": trolleys,
        "overrides": overrides or [],
    }
    results = report.write_results(done.records, done.cause, done.memory_mb, settings, out)
    drawn = draw(done.records, out)
    report.print_results(results, console)
    written = [out / "results.json", *drawn]
    console.print(f"written: {', '.join(map(str, written))}", soft_wrap=True)
    if not results["connected"]:
        raise typer.Exit(EXIT_NOT_DOCKED)


def _drawing(required: bool) -> Callable[[Sequence[DockingRecord], Path], list[Path]]:
    """What draws the pictures; nothing does, unless required, where matplotlib is not installed: on a robot."""
    try:
        from station.simulate import figures
    except ModuleNotFoundError as error:
        if required:
            raise ConfigError(f"davpc sim draws pictures with {error.name}: pip install 'davpc[plot]'") from error
        return lambda _records, _out: []
    return figures.draw_all


@app.command(epilog="Example:  davpc run follower-camera --runtime /run/davpc")
def run(
    name: Annotated[str, typer.Argument(help=f"one of {', '.join(p.name for p in PROCESSES)}")],
    runtime: Annotated[Path, typer.Option(help="private folder of the robot's sockets and frames")] = Path(
        "/run/davpc"
    ),
    shadow: Annotated[
        bool, typer.Option("--shadow", help="the CAN bridge never enables a drive and tells what it would command")
    ] = False,
    readonly: Annotated[
        bool,
        typer.Option("--readonly", help="the CAN bridge sends nothing and tells what another master's drives do"),
    ] = False,
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Run one process of the runtime. `davpc run leader`"""
    from common.executor import run_process

    try:
        process(name)
    except KeyError as error:
        raise ConfigError(str(error.args[0])) from error
    if not runtime.is_dir():
        raise ConfigError(f"{runtime}: no such folder; make it with mode 0700, or let systemd do so")
    modes = {"shadow": shadow, "readonly": readonly}
    chosen = [*(overrides or []), *(f"follower_can.{mode}=true" for mode, wanted in modes.items() if wanted)]
    raise typer.Exit(run_process(name, config or default_config_path(), runtime, chosen))


@app.command(epilog="Example:  davpc processes")
def processes() -> None:
    """List the processes of the runtime. `davpc processes`"""
    for entry in PROCESSES:
        when = f"{entry.rate_hz:.0f} Hz by {entry.stepped_by}"
        typer.echo(f"{entry.name:20s} {entry.robot:9s} FIFO {entry.priority}  {when:36s} {entry.purpose}")


app.command(epilog="Example:  sudo davpc doctor --robot follower")(cli_doctor.doctor)
app.command(epilog="Example:  davpc wiring --config /etc/davpc/robots.toml")(cli_doctor.wiring)
app.command(epilog="Example:  davpc teach 1 --runtime /run/davpc")(cli_camera.teach)
app.command(epilog="Example:  davpc jog --speed 0.05 --seconds 2")(cli_manual.jog)
app.command(epilog="Example:  davpc grip close")(cli_manual.grip)
app.command(epilog="Example:  davpc lift 200")(cli_manual.lift)
app.add_typer(cli_dock.dock, name="dock")
app.add_typer(cli_leader.led, name="led")
app.add_typer(cli_leader.lock, name="lock")
app.add_typer(cli_camera.camera, name="camera")
app.add_typer(cli_calibrate.calibrate, name="calibrate")
app.add_typer(cli_can.can, name="can")
app.add_typer(cli_network.network, name="network")
app.add_typer(cli_experiment.experiment, name="experiment")
app.add_typer(cli_experiment.bench, name="bench")


def main() -> None:
    """Entry point: a user's mistake is one line and exit code 2, a device's failure one line and 3."""
    try:
        app()
    except ConfigError as error:
        typer.echo(f"davpc: {error}", err=True)
        sys.exit(EXIT_CONFIG)
    except DeviceError as error:
        typer.echo(f"davpc: {error}", err=True)
        sys.exit(EXIT_DEVICE)


if __name__ == "__main__":
    main()
