"""``davpc experiment``: the checks of docs/safety.md, in stepped time and with real processes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from experiments.campaign import experiment as campaign
from experiments.campaign import processes as real_processes
from experiments.campaign.rows import ROWS
from experiments.fuzz import experiment as fuzz
from experiments.fuzz import live as live_fuzz
from experiments.load import experiment as load
from experiments.queues import incidents, linkcut
from experiments.queues.incident_cases import CASES
from experiments.shared.executor import Workers
from experiments.soak import experiment as soak
from experiments.soak import real as real_soak
from experiments.stop_times import experiment as stop_times
from station.fuzz_kinds import STATION_KINDS
from station.interrupts import resumable
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

safety = typer.Typer()


@safety.command("stop-times", epilog="Example:  davpc experiment stop-times --trials 100")
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


@safety.command("linkcut", epilog="Example:  davpc experiment linkcut --trials 20")
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
    judge(out, results)


@safety.command(
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
    judge(out, results)


@safety.command("campaign", epilog="Example:  davpc experiment campaign --rows S22,S08 --seeds 5 --jobs 2")
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
    with resumable(out):
        results = campaign.run(out, seed, workers, robots, seeds, chosen, controls=controls, measured=measured)
    judge(out, results)


@safety.command("fuzz", epilog="Example:  davpc experiment fuzz --messages 300000 --jobs 2")
def run_fuzz(
    messages: Annotated[int, typer.Option(min=0, help="malformed messages over all channels")] = 100_000,
    frames: Annotated[int, typer.Option(min=0, help="malformed CAN frames, a fifth of them to the Leader")] = 20_000,
    files: Annotated[int, typer.Option(min=0, help="mutations of each kind of file, and every truncation")] = 1_000,
    seconds: Annotated[float, typer.Option(min=0.0, help="end sooner, after this time; 0: when all is sent")] = 0.0,
    live: Annotated[
        int | None,
        typer.Option(min=1000, help="instead: malformed messages into running processes", show_default="–"),
    ] = None,
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
    if live is not None:
        judge(out, live_fuzz.run(out, config, seed, live, overrides or [], typer.echo))
        return
    plan = fuzz.FuzzPlan(messages=messages, frames=frames, files=files, seconds=seconds)
    judge(out, fuzz.run(out, seed, Workers(jobs, cluster), loaded(config, overrides), plan, STATION_KINDS))


@safety.command("soak", epilog="Example:  davpc experiment soak --hours 24 --jobs 2")
def run_soak(
    hours: Annotated[float, typer.Option(min=0.001, help="simulated hours of dockings with faults")] = 24.0,
    real: Annotated[
        float | None,
        typer.Option(min=0.5, help="instead: minutes of real processes without faults", show_default="–"),
    ] = None,
    seed: SeedOption = 1,
    jobs: JobsOption = CORES,
    cluster: ClusterOption = "",
    out: OutOption = Path("out/soak"),
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Collections for hours, a recoverable fault in most dockings: nothing unsafe, no end without a name, no growth.

    The same call with the same --out goes on where it stopped. Exit code 1 if anything is unsafe, unnamed or grows.
    """
    if real is not None:
        judge(out, real_soak.run(out, config, real, overrides or [], typer.echo))
    else:
        with resumable(out):
            results = soak.run(out, seed, Workers(jobs, cluster), loaded(config, overrides), hours)
        judge(out, results)


@safety.command("load", epilog="Example:  davpc experiment load --cases stranger,impostor,ports --seconds 20")
def run_load(
    seconds: Annotated[float, typer.Option(min=1.0, help="of each load")] = 15.0,
    cases: CasesOption = "",
    out: OutOption = Path("out/load"),
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Both robots with their network as real processes under load: what gives, in which order, whether safely.

    CPU, disk, floods by a stranger and by an impostor, garbage on the gateways' ports, 200 subscribers.
    Exit code 1 if commands pause for more than 120 ms without a stop, or anything is not normal 1 s afterwards.
    """
    chosen = names(cases, tuple(load.LOADS), "load")
    judge(out, load.run(out, config, seconds, overrides or [], typer.echo, chosen))
