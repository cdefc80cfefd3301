"""``davpc experiment``: the paper's tables and figures; the checks of docs/safety.md are beside it."""

from __future__ import annotations

import secrets
from pathlib import Path
from typing import Annotated

import typer

from experiments.contact import experiment as contact
from experiments.feature_level import disturbance, sweep, table1, trajectories
from experiments.feature_level.scenes import DISTURBANCES
from experiments.feature_level.sets import SetName
from experiments.perception import experiment as perception
from experiments.queues import scenarios, sequential
from experiments.shared.executor import Workers
from experiments.tolerance import experiment as tolerance
from experiments.tolerance.robots import CLASSES
from experiments.tolerance.robots import METHODS as LEARNED
from experiments.tuning import experiment as tuning
from experiments.tuning.spaces import SPACES
from station.options import (
    CORES,
    CasesOption,
    ClusterOption,
    ConfigOption,
    JobsOption,
    MethodsOption,
    OutOption,
    SeedOption,
    SetOption,
    judge,
    loaded,
    names,
    show,
)
from station.safety_experiments import safety

experiment = typer.Typer(no_args_is_help=True, help="Run the paper's experiments. `davpc experiment table1`")

SetsOption = Annotated[
    str,
    typer.Option(
        "--sets",
        help="comma-separated: lab, as in the paper; evaluation, other starts, disturbances and held noise, on which "
        "nothing was tuned",
    ),
]
PixelsOption = Annotated[
    bool, typer.Option("--pixels", help="render every frame and run the whole perception; some 10 s a run")
]


@experiment.command("table1", epilog="Example:  davpc experiment table1 --trials 100 --out out/table1")
def run_table1(
    trials: Annotated[int, typer.Option(min=1, help="starts of each method and case")] = 100,
    methods: MethodsOption = "",
    cases: CasesOption = "",
    sets: SetsOption = "lab",
    pixels: PixelsOption = False,
    seed: SeedOption = 1,
    jobs: JobsOption = CORES,
    cluster: ClusterOption = "",
    out: OutOption = Path("out/table1"),
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """The paper's Table I: every method from the same starts, under the same noise.

    Cases: T the paper's range of starts, W a wider one, T_tilted the runtime's array; of --sets evaluation E, with
    other starts and noise held for three frames, and E_white, with the paper's noise.
    """
    chosen_sets = names(sets, tuple(table1.CASES_OF_SETS), "set")
    known = tuple(case for chosen in chosen_sets for case in table1.CASES_OF_SETS[chosen])
    chosen_methods = names(methods, table1.METHODS, "method") if methods else table1.DEFAULT_METHODS
    chosen_cases = names(cases, table1.PIXEL_CASES if pixels else known, "case")
    chosen = chosen_methods, chosen_cases
    table1.run(out, seed, Workers(jobs, cluster), loaded(config, overrides), trials, *chosen, pixels=pixels)
    show(out)


@experiment.command("trajectories", epilog="Example:  davpc experiment trajectories")
def run_trajectories(
    seed: SeedOption = 1,
    jobs: JobsOption = CORES,
    cluster: ClusterOption = "",
    out: OutOption = Path("out/trajectories"),
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """The paper's comparative figure: four starts, three methods."""
    trajectories.run(out, seed, Workers(jobs, cluster), loaded(config, overrides))
    show(out)


@experiment.command("disturbance", epilog="Example:  davpc experiment disturbance --trials 16")
def run_disturbance(
    trials: Annotated[int, typer.Option(min=1, help="starts of each method and case")] = 16,
    methods: MethodsOption = "",
    cases: CasesOption = "",
    sets: SetsOption = "lab",
    held_out: Annotated[
        bool, typer.Option("--held-out", help="instead: start, size, place and combination drawn again for each run")
    ] = False,
    pixels: PixelsOption = False,
    seed: Annotated[
        int | None, typer.Option(min=0, help="random seed", show_default="1; with --held-out a new one")
    ] = None,
    jobs: JobsOption = CORES,
    cluster: ClusterOption = "",
    out: OutOption = Path("out/disturbance"),
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Pads, load, lag and drift: with and without disturbance rejection."""
    chosen = names(methods, disturbance.METHODS, "method"), names(cases, tuple(DISTURBANCES), "case")
    flown: tuple[SetName, ...] = ("held_out",)
    if not held_out:
        flown = tuple(name for name in disturbance.SETS if name in names(sets, disturbance.SETS, "set"))
    if seed is None:
        seed = secrets.randbelow(2**31) if held_out else 1
    robots = loaded(config, overrides)
    disturbance.run(out, seed, Workers(jobs, cluster), robots, trials, *chosen, pixels=pixels, sets=flown)
    show(out)
    typer.echo(f"seed: {seed}")


@experiment.command("tolerance", epilog="Example:  davpc experiment tolerance --robots 50 --jobs 2")
def run_tolerance(
    robots: Annotated[int, typer.Option(min=1, help="drawn for each class of error")] = 50,
    methods: MethodsOption = "",
    cases: CasesOption = "",
    sensitivities: Annotated[bool, typer.Option(help="dock one error at a time too")] = True,
    seed: SeedOption = 1,
    jobs: JobsOption = CORES,
    cluster: ClusterOption = "",
    out: OutOption = Path("out/tolerance"),
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Robots that are not as configured: what errors of camera, lens, LEDs and wheels cost at the dock."""
    chosen = names(methods, tuple(LEARNED), "method"), names(cases, tuple(CLASSES), "case")
    workers = Workers(jobs, cluster)
    tolerance.run(out, seed, workers, loaded(config, overrides), robots, *chosen, sensitivities=sensitivities)
    show(out)


@experiment.command("sweep", epilog="Example:  davpc experiment sweep --trials 10")
def run_sweep(
    trials: Annotated[int, typer.Option(min=1, help="starts of each setting")] = 10,
    seed: SeedOption = 1,
    jobs: JobsOption = CORES,
    cluster: ClusterOption = "",
    out: OutOption = Path("out/sweep"),
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Accuracy, smoothness and solve time against the horizon and the observer's bandwidth."""
    sweep.run(out, seed, Workers(jobs, cluster), loaded(config, overrides), trials)
    show(out)


@experiment.command("tune", epilog="Example:  davpc experiment tune --methods ke --evaluations 48 --trials 6")
def run_tune(
    methods: MethodsOption = "",
    evaluations: Annotated[int, typer.Option(min=1, help="candidates of each method")] = 48,
    trials: Annotated[int, typer.Option(min=1, help="training runs of each candidate")] = 6,
    seed: SeedOption = 1,
    jobs: JobsOption = CORES,
    cluster: ClusterOption = "",
    out: OutOption = Path("out/tune"),
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Search each method's gains with the same budget, on a training set that no table reports."""
    chosen = names(methods, tuple(SPACES), "method")
    tuning.run(out, seed, Workers(jobs, cluster), loaded(config, overrides), chosen, evaluations, trials)
    show(out)


@experiment.command("perception", epilog="Example:  davpc experiment perception --seeds 20 --scenes clean,glass_hall")
def run_perception(
    seeds: Annotated[int, typer.Option(min=1, help="approaches per scene")] = 20,
    scenes: Annotated[str, typer.Option(help="comma-separated; all when empty")] = "",
    jobs: JobsOption = CORES,
    cluster: ClusterOption = "",
    out: OutOption = Path("out/perception"),
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Hard scenes: losses, wrong LEDs, false locks, and both routes to the pose beside the bound."""
    chosen = names(scenes, tuple(perception.SCENES), "scene")
    perception.run(out, loaded(config, overrides), seeds, chosen, workers=Workers(jobs, cluster))
    show(out)


@experiment.command("contact", epilog="Example:  davpc experiment contact --trials 100")
def run_contact(
    trials: Annotated[int, typer.Option(min=1, help="pushes, and as many approaches over pads")] = 100,
    seed: SeedOption = 1,
    jobs: JobsOption = CORES,
    cluster: ClusterOption = "",
    out: OutOption = Path("out/contact"),
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Contact recognised in pushes of varied speed and load, and none over rubber pads."""
    contact.run(out, seed, trials, loaded(config, overrides), Workers(jobs, cluster))
    show(out)


@experiment.command("sequential", epilog="Example:  davpc experiment sequential --trolleys 8 --trials 10 --jobs 2")
def run_sequential(
    trolleys: Annotated[int, typer.Option(min=1, max=30, help="in each queue")] = 8,
    trials: Annotated[int, typer.Option(min=1, help="queues")] = 10,
    seed: SeedOption = 1,
    jobs: JobsOption = CORES,
    cluster: ClusterOption = "",
    out: OutOption = Path("out/sequential"),
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """The paper's sequential docking: errors by trolley, beside the bounds and what the smaller image allows.

    Exit code 1 if a trolley is not locked within its bound.
    """
    results = sequential.run(out, seed, Workers(jobs, cluster), loaded(config, overrides), trials, trolleys)
    judge(out, results)


@experiment.command("scenarios", epilog="Example:  davpc experiment scenarios --trials 20 --cases glass_hall")
def run_scenarios(
    trials: Annotated[int, typer.Option(min=1, help="dockings in each scenario")] = 20,
    cases: CasesOption = "",
    seed: SeedOption = 1,
    jobs: JobsOption = CORES,
    cluster: ClusterOption = "",
    out: OutOption = Path("out/scenarios"),
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """The paper's real-world scenarios: dark outdoors, parking lot, glass hall. Exit code 1 if one does not dock."""
    chosen = names(cases, tuple(scenarios.SCENARIOS), "scenario")
    results = scenarios.run(out, seed, Workers(jobs, cluster), loaded(config, overrides), trials, chosen)
    judge(out, results)


experiment.add_typer(safety)
