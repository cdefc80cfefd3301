"""What pads, load, lag and bias do to each method: ``davpc experiment disturbance``."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from common.config import Config
from experiments.feature_level.plots import draw_disturbed_runs
from experiments.feature_level.runs import all_jobs, fly_job, make_case, metrics_job, table
from experiments.feature_level.scenes import (
    DISTURBANCES,
    DISTURBED_START,
    PAPER_DISTURBANCE,
    Level,
    level_settings,
    paper_start,
    random_pads,
)
from experiments.feature_level.trial import Outcome
from experiments.shared.executor import Workers, run_all
from experiments.shared.results import write_results

METHODS = ("vpc", "paper", "davpc")


def run(
    out: Path,
    seed: int,
    workers: Workers,
    config: Config,
    trials: int = 16,
    methods: tuple[str, ...] = METHODS,
    cases: tuple[str, ...] = tuple(DISTURBANCES),
    pixels: bool = False,
) -> dict[str, Any]:
    """Fly from the paper's start under each disturbance; write the results and the paper's figure.

    Args:
        out: folder for the results.
        seed: random seed.
        workers: who does the runs.
        config: the robots.
        trials: runs of each method under each disturbance.
        methods: ``vpc`` is the paper's control without observer and compensation, ``paper`` with both.
        cases: names from ``DISTURBANCES``.
        pixels: render every frame and put it through the whole perception, with the array as configured.
    """
    level: Level = "pixels" if pixels else "features"
    start = paper_start(DISTURBED_START)
    todo = [
        make_case(config, method, name, [start] * trials, DISTURBANCES[name], seed, level=level)
        for name in cases
        for method in methods
    ]
    pads = random_pads(seed)
    shown = [make_case(config, method, "paper_pads", [start], pads, seed, level=level) for method in methods]
    metrics = run_all(metrics_job, all_jobs(todo), workers, "disturbance")
    outcomes: list[Outcome] = run_all(fly_job, all_jobs(shown), workers, "the paper's pads")
    rows = table(todo, metrics) + table(shown, [outcome.metrics for outcome in outcomes])
    settings = _settings(trials, cases) | level_settings(config, level, cases)
    results = write_results(out, "disturbance", seed, settings, rows, list(PAPER_DISTURBANCE), config)
    traces = {method: outcome.trace for method, outcome in zip(methods, outcomes, strict=True)}
    draw_disturbed_runs(traces, pads.pads, out / "disturbance.png")
    return results


def _settings(trials: int, cases: tuple[str, ...]) -> dict[str, Any]:
    return {
        "trials": trials,
        "start": list(DISTURBED_START),
        "disturbances": {name: asdict(DISTURBANCES[name]) for name in cases},
    }
