"""Accuracy, smoothness and solve time against horizon and observer bandwidth: ``davpc experiment sweep``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from common.config import Config
from experiments.bench.control import record_problems, time_solver
from experiments.feature_level.plots import draw_sweep
from experiments.feature_level.runs import MethodCase, Rows, all_jobs, make_case, metrics_job
from experiments.feature_level.scenes import method_config
from experiments.feature_level.sets import disturbed_setting, undisturbed_setting
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
            setting = with_horizon(config, horizon)
            runs = undisturbed_setting(method_config(config, method), "T", trials, seed)
            cases.append(make_case(setting, method, f"horizon_{horizon}", runs, seed))
            varied.append(setting)
    for bandwidth in BANDWIDTHS_RAD_S:
        setting = with_bandwidth(config, bandwidth)
        runs = disturbed_setting(config, "lab", "yaw_pads", trials, seed)
        cases.append(make_case(setting, "paper", f"bandwidth_{bandwidth}", runs, seed))
        varied.append(setting)
    settings = {"trials": trials, "horizons": list(HORIZONS), "bandwidths_rad_s": list(BANDWIDTHS_RAD_S)}

    def write(rows: list[dict[str, Any]]) -> dict[str, Any]:
        return write_results(out, "sweep", seed, settings, rows, [], config)

    kept = Rows(cases, write)
    run_all(metrics_job, all_jobs(cases), workers, "sweep", keep=kept.keep)
    rows = kept.rows()
    for entry, case, setting in zip(rows, cases, varied, strict=True):
        if case.name.startswith("horizon"):
            entry["metrics"]["solve_ms"] = _median_ms(setting, case, seed)
    results = write(rows)
    draw_sweep(rows, out / "sweep.png")
    return results


def _median_ms(config: Config, case: MethodCase, seed: int) -> float:
    setting = method_config(config, case.method)
    problems = record_problems(setting, TIMED_PROBLEMS, seed)
    return time_solver(setting, setting.controller.method, problems).median_ms
