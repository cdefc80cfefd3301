"""The paper's figure "Comparative simulation results": ``davpc experiment trajectories``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from common.config import Config
from experiments.feature_level.feature_world import Disturbances
from experiments.feature_level.plots import draw_trajectories
from experiments.feature_level.runs import Rows, all_jobs, fly_job, make_case
from experiments.feature_level.scenes import PAPER_STARTS, PAPER_TABLE, method_config, paper_start
from experiments.feature_level.sets import Setting
from experiments.shared.executor import Workers, run_all
from experiments.shared.results import write_results

METHODS = ("ibvs", "ke", "davpc")


def run(out: Path, seed: int, workers: Workers, config: Config, methods: tuple[str, ...] = METHODS) -> dict[str, Any]:
    """Fly the paper's four starts with each method; write results and ``trajectories.png``.

    Args:
        out: folder for the results.
        seed: random seed.
        workers: who does the runs.
        config: the robots.
        methods: which to fly.
    """
    starts = [paper_start(start) for start in PAPER_STARTS]
    runs = Setting(starts, [Disturbances()] * len(starts), 1)
    cases = [make_case(config, method, "paper_starts", runs, seed) for method in methods]
    settings = {"starts": [list(start) for start in PAPER_STARTS], "methods": list(methods)}

    def write(rows: list[dict[str, Any]]) -> dict[str, Any]:
        return write_results(out, "trajectories", seed, settings, rows, list(PAPER_TABLE), config)

    kept = Rows(cases, write)
    outcomes = run_all(
        fly_job,
        all_jobs(cases),
        workers,
        "trajectories",
        keep=lambda job, outcome: kept.keep(job, outcome.metrics),
    )
    count = len(starts)
    traces = {
        method: [outcome.trace for outcome in outcomes[i * count : (i + 1) * count]]
        for i, method in enumerate(methods)
    }
    draw_trajectories(traces, method_config(config, "davpc"), out / "trajectories.png")
    return write(kept.rows())
