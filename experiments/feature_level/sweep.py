"""Accuracy, smoothness and solve time against horizon and observer bandwidth: ``davpc experiment sweep``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from common.config import Config
from experiments.bench.control import record_problems, time_solver
from experiments.feature_level.plots import draw_sweep
from experiments.feature_level.runs import MethodCase, all_jobs, make_case, metrics_job, table
from experiments.feature_level.scenes import DISTURBANCES, DISTURBED_START, method_config, paper_start, random_starts
from experiments.feature_level.sweep_settings import with_bandwidth, with_horizon
from experiments.shared.executor import Workers, run_all
from experiments.shared.results import write_results

HORIZONS = (10, 20, 30, 40, 60)
BANDWIDTHS_RAD_S = (0.25, 0.5, 1.0, 2.0, 4.0)
TIMED_PROBLEMS = 40


def run(out: Path, seed: int, workers: Workers, config: Config, trials: int = 10) -> dict[str, Any]:
    """Vary N_p of both methods without a disturbance, and ω_o of the paper's observer with yaw pads.

    Args:
        out: folder for the results.
        seed: random seed.
        workers: who does the runs.
        config: the robots.
        trials: runs of each setting.
    """
    cases, varied = [], []
    for method in ("paper", "davpc"):
        for horizon in HORIZONS:
            starts = random_starts(method_config(config, method), "T", trials, seed)
            setting = with_horizon(config, horizon)
            cases.append(make_case(setting, method, f"horizon_{horizon}", starts, DISTURBANCES["none"], seed))
            varied.append(setting)
    for bandwidth in BANDWIDTHS_RAD_S:
        setting = with_bandwidth(config, bandwidth)
        starts = [paper_start(DISTURBED_START)] * trials
        cases.append(make_case(setting, "paper", f"bandwidth_{bandwidth}", starts, DISTURBANCES["yaw_pads"], seed))
        varied.append(setting)
    rows = table(cases, run_all(metrics_job, all_jobs(cases), workers, "sweep"))
    for entry, case, setting in zip(rows, cases, varied, strict=True):
        if case.name.startswith("horizon"):
            entry["metrics"]["solve_ms"] = _median_ms(setting, case, seed)
    settings = {"trials": trials, "horizons": list(HORIZONS), "bandwidths_rad_s": list(BANDWIDTHS_RAD_S)}
    results = write_results(out, "sweep", seed, settings, rows, [], config)
    draw_sweep(rows, out / "sweep.png")
    return results


def _median_ms(config: Config, case: MethodCase, seed: int) -> float:
    setting = method_config(config, case.method)
    problems = record_problems(setting, TIMED_PROBLEMS, seed)
    return time_solver(setting, setting.controller.method, problems).median_ms
