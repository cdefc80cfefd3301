"""``davpc experiment``: the paper's tables and figures, and the checks of docs/safety.md."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any

import typer

from experiments.campaign import experiment as campaign
from experiments.campaign import processes as real_processes
from experiments.campaign.rows import ROWS
from experiments.contact import experiment as contact
from experiments.feature_level import disturbance, sweep, table1, trajectories
from experiments.feature_level.scenes import DISTURBANCES
from experiments.fuzz import experiment as fuzz
from experiments.perception import experiment as perception
from experiments.queues import incidents, linkcut, scenarios, sequential
from experiments.queues.incident_cases import CASES
from experiments.shared.executor import Workers
from experiments.stop_times import experiment as stop_times
from station.fuzz_kinds import STATION_KINDS
from station.options import (
    ClusterOption,
    ConfigOption,
    JobsOption,
    OutOption,
    SeedOption,
    SetOption,
    loaded,
    names,
    show,
)

experiment = typer.Typer(no_args_is_help=True, help="Run the paper's experiments. `davpc experiment table1`")

MethodsOption = Annotated[str, typer.Option(help="comma-separated; the usual ones when empty")]
CasesOption = Annotated[str, typer.Option(help="comma-separated; all when empty")]
PixelsOption = Annotated[
    bool, typer.Option("--pixels", help="render every frame and run the whole perception; some 10 s a run")
]
CORES = os.cpu_count() or 1
EXIT_MISSED = 1


@experiment.command("table1", epilog="Example:  davpc experiment table1 --trials 100 --out out/table1")
def run_table1(
    trials: Annotated[int, typer.Option(min=1, help="starts of each method and case")] = 100,
    methods: MethodsOption = "",
    cases: CasesOption = "",
    pixels: PixelsOption = False,
    seed: SeedOption = 1,
    jobs: JobsOption = CORES,
    cluster: ClusterOption = "",
    out: OutOption = Path("out/table1"),
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """The paper's Table I: every method from the same starts, under the same noise."""
    known = table1.PIXEL_CASES if pixels else table1.CASES
    chosen_methods = names(methods, table1.METHODS, "method") if methods else table1.DEFAULT_METHODS
    chosen_cases = names(cases, known, "case")
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
    pixels: PixelsOption = False,
    seed: SeedOption = 1,
    jobs: JobsOption = CORES,
    cluster: ClusterOption = "",
    out: OutOption = Path("out/disturbance"),
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Pads, load, lag and drift: with and without disturbance rejection."""
    chosen = names(methods, disturbance.METHODS, "method"), names(cases, tuple(DISTURBANCES), "case")
    disturbance.run(out, seed, Workers(jobs, cluster), loaded(config, overrides), trials, *chosen, pixels=pixels)
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


@experiment.command("stop-times", epilog="Example:  davpc experiment stop-times --trials 100")
def run_stop_times(
    trials: Annotated[
        int,
        typer.Option(
            min=1, help="of each fault of the controller; half as many of the bridge's, three tenths of others'"
        ),
    ] = 100,
    stalls: Annotated[int, typer.Option(min=0, help="stalls of controller or bridge, 0.2 to 10 s")] = 50,
    methods: MethodsOption = "",
    seed: SeedOption = 1,
    out: OutOption = Path("out/stop-times"),
    config: ConfigOption = None,
) -> None:
    """How long the wheels keep turning after a process was killed or stopped."""
    stop_times.run(out, config, trials, stalls, seed, typer.echo, names(methods, stop_times.NAMES, "method"))
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
    _judge(out, results)


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
    _judge(out, results)


@experiment.command("linkcut", epilog="Example:  davpc experiment linkcut --trials 20")
def run_linkcut(
    trials: Annotated[int, typer.Option(min=1, help="pairs of runs")] = 20,
    seed: SeedOption = 1,
    jobs: JobsOption = CORES,
    cluster: ClusterOption = "",
    out: OutOption = Path("out/linkcut"),
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """The robots' link cut in the approach: the velocity commands stay bit-identical; exit code 1 if not."""
    results = linkcut.run(out, seed, Workers(jobs, cluster), loaded(config, overrides), trials)
    _judge(out, results)


@experiment.command(
    "incidents", epilog="Example:  davpc experiment incidents --trials 5 --cases 'hidden 5 s,Leader off in push'"
)
def run_incidents(
    trials: Annotated[int, typer.Option(min=1, help="seeds of each incident")] = 5,
    cases: CasesOption = "",
    seed: SeedOption = 1,
    jobs: JobsOption = CORES,
    cluster: ClusterOption = "",
    out: OutOption = Path("out/incidents"),
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Hidden LEDs, jams, stuck switches, a dead LED or Leader: reaction and cause as docs/safety.md requires.

    Exit code 1 if one differs.
    """
    chosen = names(cases, tuple(CASES), "incident")
    results = incidents.run(out, seed, Workers(jobs, cluster), loaded(config, overrides), trials, chosen)
    _judge(out, results)


@experiment.command("campaign", epilog="Example:  davpc experiment campaign --rows S22,S08 --seeds 5 --jobs 2")
def run_campaign(
    seeds: Annotated[
        int, typer.Option("--seeds", "--trials", min=1, help="dockings from which faults branch off")
    ] = 25,
    rows: Annotated[str, typer.Option(help="comma-separated rows of docs/safety.md; all when empty")] = "",
    controls: Annotated[
        bool, typer.Option("--controls", help="remove one check after the other; rows must notice")
    ] = False,
    processes: Annotated[bool, typer.Option("--processes", help="also kill and stop real processes")] = False,
    seed: SeedOption = 1,
    jobs: JobsOption = CORES,
    cluster: ClusterOption = "",
    out: OutOption = Path("out/campaign"),
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Every failure mode of docs/safety.md in every phase in which it matters, judged by the simulated world.

    The same call with the same --out goes on where it stopped. Exit code 1 if anything is unsafe, wrong or late.
    """
    chosen = names(rows, tuple(ROWS), "row")
    robots = loaded(config, overrides)
    measured = real_processes.run(out, config, seeds, seed, chosen, typer.echo) if processes else ([], [])
    workers = Workers(jobs, cluster)
    _judge(out, campaign.run(out, seed, workers, robots, seeds, chosen, controls=controls, measured=measured))


@experiment.command("fuzz", epilog="Example:  davpc experiment fuzz --messages 300000 --jobs 2")
def run_fuzz(
    messages: Annotated[int, typer.Option(min=0, help="malformed messages over all channels")] = 100_000,
    frames: Annotated[int, typer.Option(min=0, help="malformed CAN frames, a fifth of them to the Leader")] = 20_000,
    files: Annotated[int, typer.Option(min=0, help="mutations of each kind of file, and every truncation")] = 1_000,
    seconds: Annotated[float, typer.Option(min=0.0, help="end sooner, after this time; 0: when all is sent")] = 0.0,
    seed: SeedOption = 1,
    jobs: JobsOption = CORES,
    cluster: ClusterOption = "",
    out: OutOption = Path("out/fuzz"),
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Malformed messages, files, overrides and CAN frames: nothing raises, moves or grows.

    Exit code 1 if anything does; each such input is kept in findings/ of --out.
    """
    plan = fuzz.FuzzPlan(messages=messages, frames=frames, files=files, seconds=seconds)
    _judge(out, fuzz.run(out, seed, Workers(jobs, cluster), loaded(config, overrides), plan, STATION_KINDS))


def _judge(out: Path, results: dict[str, Any]) -> None:
    """Show the results; exit code 1 where a run did not end as it must."""
    show(out)
    if results["settings"]["missed"]:
        raise typer.Exit(EXIT_MISSED)
