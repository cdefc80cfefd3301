"""The paper's Table I, and the same on wider starts and the tilted array: ``davpc experiment table1``."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from common.config import Config
from experiments.feature_level.cramer_rao import bound
from experiments.feature_level.runs import Flight, MethodCase, Rows, all_jobs, fly_job, make_case
from experiments.feature_level.scenes import (
    DURATION_S,
    PAPER_TABLE,
    START_RANGES,
    Level,
    level_settings,
    method_config,
    pixel_config,
)
from experiments.feature_level.sets import HELD_FRAMES, undisturbed_setting
from experiments.feature_level.trial import goal_task
from experiments.shared.executor import Workers, run_all
from experiments.shared.results import row, write_results

CASES_OF_SETS = {"lab": ("T", "W", "T_tilted"), "evaluation": ("E", "E_white")}
CASES = CASES_OF_SETS["lab"]
ALL_CASES = tuple(case for cases in CASES_OF_SETS.values() for case in cases)
PIXEL_CASES = ("T", "W")
BOUND_RUNS = 10
METHODS = ("ibvs", "ke", "pose_based", "paper", "paper_compensated", "davpc")
DEFAULT_METHODS = ("ibvs", "ke", "pose_based", "paper", "davpc")
FLOWN = {"paper": "vpc", "paper_compensated": "paper"}  # names of this table -> of the pilots
NOTE = (
    "`paper`: the nominal controller (VPC) without compensation, as in the paper's simulation, from the observer's "
    "state (`controller.compensation.initial_state`); in the disturbance experiment it is called `vpc`. "
    "`paper_compensated`: with compensation; there it is `paper`."
)


def run(
    out: Path,
    seed: int,
    workers: Workers,
    config: Config,
    trials: int = 100,
    methods: tuple[str, ...] = DEFAULT_METHODS,
    cases: tuple[str, ...] | None = None,
    pixels: bool = False,
) -> dict[str, Any]:
    """Fly every method from the same random starts under the same noise; write ``results.json`` and ``table.md``.

    Args:
        out: folder to write to.
        seed: of starts and noise.
        workers: who does the runs.
        trials: starts for each case.
        cases: ``T`` the paper's range, ``W`` a wider one, ``T_tilted`` the runtime's array; ``E`` of the evaluation
            set, on which nothing was tuned, ``E_white`` with white noise; None: all of the lab's set.
        pixels: render every frame and run the whole perception, with the array as configured in every case. The
            bound, which is that of the feature level's noise, is left out.

    Raises:
        ValueError: an unknown method or case.
    """
    known = PIXEL_CASES if pixels else ALL_CASES
    cases = (PIXEL_CASES if pixels else CASES) if cases is None else cases
    unknown = [case for case in cases if case not in known]
    if unknown:
        raise ValueError(f"case {unknown[0]!r} is none of {', '.join(known)}")
    level: Level = "pixels" if pixels else "features"
    todo = [_case(config, method, name, trials, seed, level) for name in cases for method in methods]
    settings = _settings(trials, methods) | level_settings(config, level, cases)

    def write(rows: list[dict[str, Any]]) -> dict[str, Any]:
        return write_results(out, "table1", seed, settings, rows, list(PAPER_TABLE), config, NOTE)

    kept = Rows(todo, write)
    done = run_all(
        measured_job, all_jobs(todo), workers, "table1", keep=lambda job, result: kept.keep(job, result[0])
    )
    limits = [(case.name, limit) for (case, _), (_, limit) in zip(all_jobs(todo), done, strict=True)]
    return write(kept.rows() + _bound_rows(cases, limits))


def _case(config: Config, method: str, name: str, trials: int, seed: int, level: Level = "features") -> MethodCase:
    array = "tilted" if name.endswith("tilted") else "vertical"
    flown = FLOWN.get(method, method)
    seen = pixel_config(config, flown) if level == "pixels" else method_config(config, flown, array)
    return make_case(config, flown, name, undisturbed_setting(seen, name, trials, seed), seed, array, method, level)


def measured_job(job: Flight) -> tuple[dict[str, float], dict[str, float] | None]:
    """A flight's metrics and, of the default method's first ones at feature level, the Cramér–Rao bound along it."""
    case, i = job
    outcome = fly_job(job)
    if case.method != "davpc" or case.level != "features" or i >= BOUND_RUNS:
        return outcome.metrics, None
    task = goal_task(method_config(Config.model_validate_json(case.config_text), case.method, case.array))
    return outcome.metrics, bound(task, outcome.trace)


def _bound_rows(cases: tuple[str, ...], limits: list[tuple[str, dict[str, float] | None]]) -> list[dict[str, Any]]:
    """The bound of each case, averaged over the flights that have one."""
    rows = []
    for name in cases:
        mine = [limit for case, limit in limits if case == name and limit is not None]
        if mine:
            mean = {key: float(np.mean([limit[key] for limit in mine])) for key in mine[0]}
            rows.append(row("cramer_rao", name, len(mine), mean))
    return rows


def _settings(trials: int, methods: tuple[str, ...]) -> dict[str, Any]:
    return {
        "trials": trials,
        "methods": list(methods),
        "duration_s": DURATION_S,
        "noise_held_frames": {"E": HELD_FRAMES},
        "starts": {name: asdict(limits) for name, limits in START_RANGES.items()},
        "note": NOTE,
    }
