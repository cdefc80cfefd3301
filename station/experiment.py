"""``davpc experiment`` and ``davpc bench``: the paper's tables and figures, and what things cost."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any

import typer

from station.options import ConfigOption, JobsOption, OutOption, SeedOption, SetOption, loaded, names

experiment = typer.Typer(no_args_is_help=True, help="Run the paper's experiments. `davpc experiment table1`")
bench = typer.Typer(no_args_is_help=True, help="Measure side by side what things cost. `davpc bench control`")

MethodsOption = Annotated[str, typer.Option(help="comma-separated; all when empty")]
CasesOption = Annotated[str, typer.Option(help="comma-separated; all when empty")]
PixelsOption = Annotated[
    bool, typer.Option("--pixels", help="render every frame and run the whole perception; some 10 s a run")
]
CORES = os.cpu_count() or 1
EXIT_MISSED = 1


@experiment.command(epilog="Example:  davpc experiment table1 --trials 100 --out out/table1")
def table1(
    trials: Annotated[int, typer.Option(min=1)] = 100,
    methods: MethodsOption = "",
    cases: CasesOption = "",
    pixels: PixelsOption = False,
    seed: SeedOption = 1,
    jobs: JobsOption = CORES,
    out: OutOption = Path("out/table1"),
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """The paper's Table I: every method from the same starts, under the same noise."""
    from experiments.feature_level import table1 as module

    known = module.PIXEL_CASES if pixels else module.CASES
    chosen_methods = names(methods, module.METHODS, "method") if methods else module.DEFAULT_METHODS
    chosen_cases = names(cases, known, "case")
    module.run(out, seed, jobs, loaded(config, overrides), trials, chosen_methods, chosen_cases, pixels=pixels)
    _show(out)


@experiment.command(epilog="Example:  davpc experiment trajectories")
def trajectories(
    seed: SeedOption = 1,
    jobs: JobsOption = CORES,
    out: OutOption = Path("out/trajectories"),
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """The paper's comparative figure: four starts, three methods."""
    from experiments.feature_level import trajectories as module

    module.run(out, seed, jobs, loaded(config, overrides))
    _show(out)


@experiment.command(epilog="Example:  davpc experiment disturbance --trials 16")
def disturbance(
    trials: Annotated[int, typer.Option(min=1)] = 16,
    methods: MethodsOption = "",
    cases: CasesOption = "",
    pixels: PixelsOption = False,
    seed: SeedOption = 1,
    jobs: JobsOption = CORES,
    out: OutOption = Path("out/disturbance"),
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Pads, load, lag and drift: with and without disturbance rejection."""
    from experiments.feature_level import disturbance as module
    from experiments.feature_level.scenes import DISTURBANCES

    chosen = names(methods, module.METHODS, "method"), names(cases, tuple(DISTURBANCES), "case")
    module.run(out, seed, jobs, loaded(config, overrides), trials, *chosen, pixels=pixels)
    _show(out)


@experiment.command(epilog="Example:  davpc experiment sweep --trials 10")
def sweep(
    trials: Annotated[int, typer.Option(min=1)] = 10,
    seed: SeedOption = 1,
    jobs: JobsOption = CORES,
    out: OutOption = Path("out/sweep"),
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Accuracy, smoothness and solve time against the horizon and the observer's bandwidth."""
    from experiments.feature_level import sweep as module

    module.run(out, seed, jobs, loaded(config, overrides), trials)
    _show(out)


@experiment.command(epilog="Example:  davpc experiment perception --seeds 20 --scenes clean,glass_hall")
def perception(
    seeds: Annotated[int, typer.Option(min=1, help="approaches per scene")] = 20,
    scenes: Annotated[str, typer.Option(help="comma-separated; all when empty")] = "",
    jobs: JobsOption = CORES,
    out: OutOption = Path("out/perception"),
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Hard scenes: losses, wrong LEDs, false locks, and both routes to the pose beside the bound."""
    from experiments.perception import experiment as module

    chosen = names(scenes, tuple(module.SCENES), "scene")
    module.run(out, loaded(config, overrides), seeds, chosen, jobs=jobs)
    _show(out)


@experiment.command("stop-times", epilog="Example:  davpc experiment stop-times --trials 100")
def stop_times(
    trials: Annotated[
        int,
        typer.Option(min=1, help="of each fault of the controller; half of the bridge's, three tenths of others'"),
    ] = 100,
    stalls: Annotated[int, typer.Option(min=0, help="of controller or bridge, 0.2 to 10 s")] = 50,
    methods: MethodsOption = "",
    seed: SeedOption = 1,
    out: OutOption = Path("out/stop-times"),
    config: ConfigOption = None,
) -> None:
    """How long the wheels go on after a process was killed or stopped."""
    from experiments.stop_times import experiment as module

    module.run(out, config, trials, stalls, seed, typer.echo, names(methods, module.NAMES, "method"))
    _show(out)


@experiment.command(epilog="Example:  davpc experiment contact --trials 100")
def contact(
    trials: Annotated[int, typer.Option(min=1, help="pushes, and as many approaches over pads")] = 100,
    seed: SeedOption = 1,
    jobs: JobsOption = CORES,
    out: OutOption = Path("out/contact"),
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Contact recognised in pushes of varied speed and load, and none over rubber pads."""
    from experiments.contact import experiment as module

    module.run(out, seed, trials, loaded(config, overrides), jobs)
    _show(out)


@experiment.command(epilog="Example:  davpc experiment sequential --trolleys 8 --trials 10 --jobs 2")
def sequential(
    trolleys: Annotated[int, typer.Option(min=1, max=30, help="in each queue")] = 8,
    trials: Annotated[int, typer.Option(min=1, help="queues")] = 10,
    seed: SeedOption = 1,
    jobs: JobsOption = CORES,
    out: OutOption = Path("out/sequential"),
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """The paper's sequential docking: errors by trolley, beside the bounds and what the smaller image allows.

    Exit code 1 if a trolley is not locked within its bound.
    """
    from experiments.queues import sequential as module

    results = module.run(out, seed, jobs, loaded(config, overrides), trials, trolleys)
    _judge(out, results)


@experiment.command(epilog="Example:  davpc experiment scenarios --trials 20 --cases glass_hall")
def scenarios(
    trials: Annotated[int, typer.Option(min=1, help="dockings in each scenario")] = 20,
    cases: CasesOption = "",
    seed: SeedOption = 1,
    jobs: JobsOption = CORES,
    out: OutOption = Path("out/scenarios"),
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """The paper's real-world scenarios: dark outdoors, parking lot, glass hall. Exit code 1 if one does not dock."""
    from experiments.queues import scenarios as module

    chosen = names(cases, tuple(module.SCENARIOS), "scenario")
    results = module.run(out, seed, jobs, loaded(config, overrides), trials, chosen)
    _judge(out, results)


@experiment.command(epilog="Example:  davpc experiment linkcut --trials 20")
def linkcut(
    trials: Annotated[int, typer.Option(min=1, help="pairs of runs")] = 20,
    seed: SeedOption = 1,
    jobs: JobsOption = CORES,
    out: OutOption = Path("out/linkcut"),
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """The robots' link cut in the approach: the velocity commands stay equal to the bit; exit code 1 if not."""
    from experiments.queues import linkcut as module

    results = module.run(out, seed, jobs, loaded(config, overrides), trials)
    _judge(out, results)


@experiment.command(epilog="Example:  davpc experiment incidents --trials 5 --cases 'hidden 5 s,Leader off in push'")
def incidents(
    trials: Annotated[int, typer.Option(min=1, help="seeds of each incident")] = 5,
    cases: CasesOption = "",
    seed: SeedOption = 1,
    jobs: JobsOption = CORES,
    out: OutOption = Path("out/incidents"),
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Hidden LEDs, jams, stuck switches, a dead LED or Leader: reaction and cause as the safety concept says.

    Exit code 1 if one is otherwise.
    """
    from experiments.queues import incidents as module
    from experiments.queues.incident_cases import CASES

    chosen = names(cases, tuple(CASES), "incident")
    results = module.run(out, seed, jobs, loaded(config, overrides), trials, chosen)
    _judge(out, results)


@bench.command(epilog="Example:  davpc bench control --problems 600")
def control(
    problems: Annotated[int, typer.Option(min=10)] = 600,
    seed: SeedOption = 1,
    out: OutOption = Path("out/bench-control"),
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """The same recorded problems through every solver."""
    from experiments.bench import control as module

    module.run(out, seed, 1, loaded(config, overrides), problems)
    _show(out)


@bench.command("perception", epilog="Example:  davpc bench perception --rounds 200")
def bench_perception(
    rounds: Annotated[int, typer.Option(min=10)] = 200,
    out: OutOption = Path("out/bench-perception"),
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Every path of perception beside what one would use instead, on the same frames."""
    from experiments.bench import perception as module

    module.run(out, loaded(config, overrides), rounds)
    _show(out)


@bench.command("can", epilog="Example:  davpc bench can --cycles 2000")
def bench_can(
    cycles: Annotated[int, typer.Option(min=100, help="of 10 ms")] = 2000,
    real_bus: Annotated[bool, typer.Option(help="the configured bus instead of simulated nodes")] = False,
    out: OutOption = Path("out/bench-can"),
    config: ConfigOption = None,
) -> None:
    """Round trip, exchange and lateness of the bridge's loop, and its share of a core."""
    from experiments.bench import can as module

    module.run(out, config, real_bus, cycles)
    _show(out)


def _judge(out: Path, results: dict[str, Any]) -> None:
    """Show the results; exit code 1 where a run did not end as it must."""
    _show(out)
    if results["settings"]["missed"]:
        raise typer.Exit(EXIT_MISSED)


def _show(out: Path) -> None:
    """Print the table that the experiment wrote, and where it lies."""
    for table in sorted(out.glob("*.md")):
        typer.echo(table.read_text(encoding="utf-8"))
    typer.echo(f"written: {', '.join(str(path) for path in sorted(out.iterdir()) if path.is_file())}")
