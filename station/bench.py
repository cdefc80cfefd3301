"""``davpc bench``: what solvers, paths of perception, the CAN bus and the recorder cost, side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from common.config import default_config_path
from experiments.bench import can, control, perception, recording
from station.options import ConfigOption, OutOption, SeedOption, SetOption, judge, loaded, show

bench = typer.Typer(no_args_is_help=True, help="Measure run times side by side. `davpc bench control`")


@bench.command("control", epilog="Example:  davpc bench control --problems 600")
def run_control(
    problems: Annotated[int, typer.Option(min=10, help="to solve with each")] = 600,
    seed: SeedOption = 1,
    out: OutOption = Path("out/bench-control"),
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Solve the same recorded problems with every solver."""
    control.run(out, seed, 1, loaded(config, overrides), problems)
    show(out)


@bench.command("perception", epilog="Example:  davpc bench perception --rounds 200")
def run_perception(
    rounds: Annotated[int, typer.Option(min=10, help="over the frames")] = 200,
    out: OutOption = Path("out/bench-perception"),
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Time every path of perception beside its alternative, on the same frames."""
    perception.run(out, loaded(config, overrides), rounds)
    show(out)


@bench.command("can", epilog="Example:  davpc bench can --cycles 2000")
def run_can(
    cycles: Annotated[int, typer.Option(min=100, help="cycles of 10 ms")] = 2000,
    real_bus: Annotated[bool, typer.Option(help="the configured bus instead of simulated nodes")] = False,
    out: OutOption = Path("out/bench-can"),
    config: ConfigOption = None,
) -> None:
    """Measure round trip, exchange and lateness of the bridge's loop, and its share of a core."""
    can.run(out, config, real_bus, cycles)
    show(out)


@bench.command("recording", epilog="Example:  davpc bench recording --pairs 3")
def run_recording(
    pairs: Annotated[int, typer.Option(min=1, max=50, help="dockings with, and as many without")] = 2,
    out: OutOption = Path("out/bench-recording"),
    config: ConfigOption = None,
) -> None:
    """Dock with the recorder on and off in turn: what it costs control, itself, and the disk."""
    path = config or default_config_path()
    judge(out, recording.run(out, loaded(path, None), path, pairs, typer.echo))
