"""What pads, load, lag and bias do to each method: ``davpc experiment disturbance``."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from common.config import Config
from experiments.feature_level.plots import draw_disturbed_runs
from experiments.feature_level.runs import Rows, all_jobs, fly_job, make_case, metrics_job
from experiments.feature_level.scenes import (
    DISTURBANCES,
    DISTURBED_START,
    PAPER_DISTURBANCE,
    Level,
    level_settings,
    paper_start,
    random_pads,
)
from experiments.feature_level.sets import EVALUATION, SetName, Setting, disturbed_setting
from experiments.feature_level.trial import Outcome
from experiments.shared.executor import Workers, run_all
from experiments.shared.results import write_results

METHODS = ("vpc", "paper", "davpc")
SETS: tuple[SetName, ...] = ("lab", "evaluation")


def run(
    out: Path,
    seed: int,
    workers: Workers,
    config: Config,
    trials: int = 16,
    methods: tuple[str, ...] = METHODS,
    cases: tuple[str, ...] = tuple(DISTURBANCES),
    pixels: bool = False,
    sets: tuple[SetName, ...] = ("lab",),
) -> dict[str, Any]:
    """Fly under each disturbance; write the results and the paper's figure.

    Args:
        out: folder for the results.
        seed: random seed.
        workers: who does the runs.
        config: the robots.
        trials: runs of each method under each disturbance.
        methods: ``vpc`` is the paper's control without compensation, ``paper`` with it.
        cases: names from ``DISTURBANCES``; those that a set does not have are left out there.
        pixels: render every frame and put it through the whole perception, with the array as configured.
        sets: of starts, disturbances and noise, see :mod:`experiments.feature_level.sets`. Outside the lab's the
            name of the set is appended to that of the case.
    """
    level: Level = "pixels" if pixels else "features"
    settings_of = {
        (chosen, name): disturbed_setting(config, chosen, name, trials, seed)
        for chosen in sets
        for name in cases
        if chosen == "lab" or name in EVALUATION
    }
    todo = [
        make_case(config, method, _case_name(chosen, name), setting, seed, level=level)
        for (chosen, name), setting in settings_of.items()
        for method in methods
    ]
    pads = random_pads(seed)
    start = Setting([paper_start(DISTURBED_START)], [pads], 1)
    shown = [make_case(config, method, "paper_pads", start, seed, level=level) for method in methods]
    settings = _settings(trials, settings_of) | level_settings(config, level, cases)

    def write(rows: list[dict[str, Any]]) -> dict[str, Any]:
        return write_results(out, "disturbance", seed, settings, rows, list(PAPER_DISTURBANCE), config)

    kept = Rows([*todo, *shown], write)
    run_all(metrics_job, all_jobs(todo), workers, "disturbance", keep=kept.keep)
    outcomes: list[Outcome] = run_all(
        fly_job,
        all_jobs(shown),
        workers,
        "the paper's pads",
        keep=lambda job, outcome: kept.keep(job, outcome.metrics),
    )
    traces = {method: outcome.trace for method, outcome in zip(methods, outcomes, strict=True)}
    draw_disturbed_runs(traces, pads.pads, out / "disturbance.png")
    return write(kept.rows())


def _case_name(chosen: SetName, name: str) -> str:
    return name if chosen == "lab" else f"{name}_{chosen}"


def _settings(trials: int, settings_of: dict[tuple[SetName, str], Setting]) -> dict[str, Any]:
    """What was flown; where each run has disturbances of its own, all of them."""
    return {
        "trials": trials,
        "start": list(DISTURBED_START),
        "disturbances": {
            _case_name(chosen, name): [asdict(each) for each in dict.fromkeys(setting.disturbances)]
            for (chosen, name), setting in settings_of.items()
        },
        "starts": {
            _case_name(chosen, name): [list(start.as_array()) for start in dict.fromkeys(setting.starts)]
            for (chosen, name), setting in settings_of.items()
        },
        "noise_held_frames": {
            _case_name(chosen, name): setting.held_frames for (chosen, name), setting in settings_of.items()
        },
    }
