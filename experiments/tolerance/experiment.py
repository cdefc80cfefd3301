"""``davpc experiment tolerance``: docked errors of robots that are not quite as configured.

For each class of error, robots are drawn from its tolerances and dock once with each method: by geometry as
configured, by a geometry that a taught image corrected, or by one calibrated from five drives. All start and see the
same. Beside it: what one millimetre costs, linearised and docked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from common.config import Config
from experiments.shared.executor import Workers, run_all
from experiments.shared.results import row, write_results
from experiments.tolerance import sensitivity
from experiments.tolerance.docking import ApproachEnd
from experiments.tolerance.plot import draw_tolerance
from experiments.tolerance.robots import CLASSES, METHODS, RobotJob, dock_job
from sim.truth import Truth

PAPER = [{"case": "trolley 1, real robots", "e_y_cm": 1.69, "e_theta_deg": 0.84}]
LATER = (2, 3, 4, 5, 6, 7, 8)
Group = tuple[str, str, list[RobotJob]]  # method, case, dockings


def run(
    out: Path,
    seed: int,
    workers: Workers,
    config: Config,
    robots: int = 50,
    methods: Sequence[str] = tuple(METHODS),
    cases: Sequence[str] = tuple(CLASSES),
    sensitivities: bool = True,
) -> dict[str, Any]:
    """Dock every drawn robot; write ``results.json``, ``table.md`` and ``tolerance.png``.

    Args:
        out: folder for the results.
        seed: random seed.
        workers: who does the runs.
        config: the robots as configured.
        robots: drawn for each class.
        methods: names from ``METHODS``.
        cases: names from ``CLASSES``; ``all`` also docks trolleys 2 to 8.
        sensitivities: dock one error at a time too.
    """
    todo = groups(config, seed, robots, methods, cases)
    ends = iter(run_all(dock_job, [job for _, _, jobs in todo for job in jobs], workers, "tolerance"))
    found = [(method, case, jobs, [next(ends) for _ in jobs]) for method, case, jobs in todo]
    rows = [row(method, case, len(jobs), metrics_of(config, jobs, done)) for method, case, jobs, done in found]
    settings = {
        "robots": robots,
        "tolerances": {case: CLASSES[case].model_dump() for case in cases},
        "runs": [
            {"method": method, "case": case, **_kept(job, end)}
            for method, case, jobs, done in found
            for job, end in zip(jobs, done, strict=True)
        ],
    }
    note = "`noticed` is empty until something notices."
    if sensitivities:
        table = _sensitivities(config, seed, workers)
        settings["sensitivities"] = [
            {"error": name, "linearised": linear, "docked": docked} for name, linear, docked in table
        ]
        note += "\n\n" + sensitivity.table(table)
    results = write_results(out, "tolerance", seed, settings, rows, PAPER, config, note)
    draw_tolerance([(method, case, done) for method, case, _, done in found], out / "tolerance.png")
    return results


def groups(config: Config, seed: int, robots: int, methods: Sequence[str], cases: Sequence[str]) -> list[Group]:
    """Dockings by method and case; robot ``i`` of a class is the same for all methods.

    Args:
        config: the robots as configured.
        seed: random seed.
        robots: of each class.
        methods: names from ``METHODS``.
        cases: names from ``CLASSES``.
    """
    text = config.model_dump_json()

    def drawn(method: str, case: str, later: bool = False, taught: tuple[int, ...] = (1,)) -> list[RobotJob]:
        within = CLASSES[case]
        return [
            RobotJob(
                text,
                method,
                Truth(seed=1000 * seed + i, tolerances=within),
                trolley=LATER[i % len(LATER)] if later else 1,
                taught=taught,
                seed=seed,
                number=i,
            )
            for i in range(robots)
        ]

    found: list[Group] = [(method, case, drawn(method, case)) for case in cases for method in methods]
    if "all" in cases:
        found += [(method, "all_trolleys_2_to_8", drawn(method, "all", later=True)) for method in methods]
        if "taught" in methods:
            jobs = drawn("taught", "all", later=True, taught=(1, 4))
            found.append(("taught", "all_trolleys_2_to_8_taught_at_1_and_4", jobs))
    return found


def metrics_of(config: Config, jobs: Sequence[RobotJob], ends: Sequence[ApproachEnd]) -> dict[str, float | None]:
    """Mean absolute errors of the robots that arrived, the worst, how many did not dock.

    ``noticed``: how many attempts warned of their geometry; None as long as nothing can.

    Args:
        config: with the lateral bounds of a docking.
        jobs: what was docked.
        ends: how each ended.
    """
    docked = [end for job, end in zip(jobs, ends, strict=True) if is_docked(config, job, end)]
    arrived = [end.error for end in ends if not end.cause]
    metrics: dict[str, float | None] = dict.fromkeys(("e_x_cm", "e_y_cm", "e_theta_deg", "worst_e_y_cm"))
    if arrived:
        lateral = 100 * np.abs([error.e_y_m for error in arrived])
        metrics |= {
            "e_x_cm": 100 * float(np.mean(np.abs([error.e_x_m for error in arrived]))),
            "e_y_cm": float(lateral.mean()),
            "e_theta_deg": float(np.mean(np.abs([error.e_theta_deg for error in arrived]))),
            "worst_e_y_cm": float(lateral.max()),
        }
    return metrics | {
        "not_docked": float(len(ends) - len(docked)),
        "noticed": None,
        "residual_px": float(np.mean([end.residual_px for end in ends])),
    }


def is_docked(config: Config, job: RobotJob, end: ApproachEnd) -> bool:
    """Arrived, and so near the axis that guide or queue take the trolley."""
    docking = config.docking
    bound_m = docking.lateral_bound_first_m if job.trolley == 1 else docking.lateral_bound_next_m
    return not end.cause and abs(end.error.e_y_m) <= bound_m


def _kept(job: RobotJob, end: ApproachEnd) -> dict[str, Any]:
    return {
        "number": job.number,
        "trolley": job.trolley,
        "cause": end.cause,
        "seconds": end.seconds,
        "residual_px": end.residual_px,
        **asdict(end.error),
    }


def _sensitivities(
    config: Config, seed: int, workers: Workers
) -> list[tuple[str, dict[str, float], dict[str, float] | None]]:
    errors = list(sensitivity.unit_errors(config))
    text = config.model_dump_json()
    jobs = [job for error in errors for job in sensitivity.jobs_of(text, error, seed)]
    ends = run_all(dock_job, jobs, workers, "sensitivities")
    found = []
    for place, error in enumerate(errors):
        pair = ends[2 * place : 2 * place + 2]
        docked = None
        if not any(end.cause for end in pair):
            docked = sensitivity.docked(error, [sensitivity.signed(end.error) for end in pair])
        found.append((error.name, sensitivity.linearised(config, error), docked))
    return found
