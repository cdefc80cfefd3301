"""The paper's sequential docking: queues of eight, each docking at pixel level: ``davpc experiment sequential``.

Each trial is one queue, built in one run. Start, loads and casters of the trolleys, where the next ones are placed
and how far nested ones roll back are drawn from the trial's seed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from common.config import Config
from experiments.queues.plots import draw_sequential
from experiments.queues.run import Docking, plan, run_plan
from experiments.shared.executor import Workers, run_all
from experiments.shared.results import missed_note, row, write_results
from follower.model.array import feature_jacobian

METRICS = ("e_x_cm", "e_y_cm", "e_theta_deg", "e_p_px")
START_M, START_SIDE_M, START_DEG = (5.0, 7.5), 1.5, 30.0
LOAD_KG = 10.0
# frames that the filter averages over, as in the paper: about 1.3 s
AVERAGED_FRAMES = 80
# limits of the mean errors: of the first trolley, which has to meet the guide, and of every other
MEAN_LIMITS = {"first": {"e_y_cm": 0.5, "e_theta_deg": 0.25}, "later": {"e_y_cm": 1.5}}
PAPER = [{"case": "trolley 1", "e_y_cm": 1.69, "e_theta_deg": 0.84}]


@dataclass(frozen=True)
class QueueJob:
    """One queue."""

    config_text: str
    trolleys: int
    seed: int
    trial: int


def run(
    out: Path, seed: int, workers: Workers, config: Config, trials: int = 10, trolleys: int = 8
) -> dict[str, Any]:
    """Dock ``trials`` queues of ``trolleys``; write ``results.json``, ``table.md`` and ``sequential.png``.

    Args:
        out: folder to write to.
        seed: random seed; the results do not depend on ``workers``.
        workers: who does the runs.
        config: the robots.
    """
    todo = [QueueJob(config.model_dump_json(), trolleys, seed, trial) for trial in range(trials)]
    queues = run_all(queue_job, todo, workers, "queues")
    bounds = [image_bound(config, trolley) for trolley in range(1, trolleys + 1)]
    rows = []
    for trolley in range(1, trolleys + 1):
        dockings = [docking for queue in queues for docking in queue if docking.trolley == trolley]
        rows.append(row("davpc", f"trolley {trolley}", trials, metrics_of(config, dockings)))
        e_y_cm, e_theta_deg = bounds[trolley - 1]
        rows.append(row("image bound", f"trolley {trolley}", 0, {"e_y_cm": e_y_cm, "e_theta_deg": e_theta_deg}))
    settings: dict[str, Any] = {
        "trials": trials,
        "trolleys": trolleys,
        "start": {"behind_m": START_M, "side_m": START_SIDE_M, "heading_deg": START_DEG},
        "load_kg": LOAD_KG,
        "image_bound": f"Cramér–Rao, {config.estimator.pixel_sigma_px} px, mean error of {AVERAGED_FRAMES} frames",
        "mean_limits": MEAN_LIMITS,
        "missed": [*missed(config, queues, trolleys), *missed_means(queues)],
    }
    note = missed_note(settings["missed"])
    results = write_results(out, "sequential", seed, settings, rows, list(PAPER), config, note)
    draw_sequential(queues, bounds, config, out / "sequential.png")
    return results


def queue_job(job: QueueJob) -> list[Docking]:
    """One queue; without the commands, which nothing reads."""
    config = Config.model_validate_json(job.config_text)
    draws = np.random.default_rng((job.seed, job.trial))
    start = [
        float(draws.uniform(*START_M)),
        float(draws.uniform(-START_SIDE_M, START_SIDE_M)),
        float(draws.uniform(-START_DEG, START_DEG)),
    ]
    world_seed = int(draws.integers(2**31))
    dockings = run_plan(plan(config, count=job.trolleys, start=start, seed=world_seed, trolley_load_kg=LOAD_KG))
    for docking in dockings:
        docking.commands.clear()
    return dockings


def metrics_of(config: Config, dockings: list[Docking]) -> dict[str, float | None]:
    """Means of the true errors, how many docked, how many beyond the bound of their trolley."""
    measured = [docking for docking in dockings if docking.metrics]
    result: dict[str, float | None] = {
        name: float(np.mean([docking.metrics[name] for docking in measured])) if measured else None
        for name in METRICS
    }
    errors = [docking.metrics["e_y_cm"] for docking in measured]
    result["worst_e_y_cm"] = max(errors) if errors else None
    result["worst_e_theta_deg"] = max((d.metrics["e_theta_deg"] for d in measured), default=None)
    result["docked"] = sum(docking.done and within(config, docking) for docking in dockings)
    result["false_locks"] = sum(docking.false_locks > 0 for docking in dockings)
    return result


def missed(config: Config, queues: list[list[Docking]], trolleys: int) -> list[str]:
    """Every docking that is not locked within its bound, that locked on something else, or that never started."""
    found = []
    for i, queue in enumerate(queues):
        found += [f"trial {i}, trolley {d.trolley}: {fault}" for d in queue if (fault := fault_of(config, d))]
        found += [f"trial {i}, trolley {k}: not begun" for k in range(len(queue) + 1, trolleys + 1)]
    return found


def missed_means(queues: list[list[Docking]]) -> list[str]:
    """Every mean error of a trolley that is beyond its limit."""
    found = []
    for trolley in sorted({docking.trolley for queue in queues for docking in queue}):
        measured = [d.metrics for queue in queues for d in queue if d.trolley == trolley and d.metrics]
        for name, limit in MEAN_LIMITS["first" if trolley == 1 else "later"].items():
            mean = float(np.mean([metrics[name] for metrics in measured])) if measured else math.nan
            if not mean <= limit:
                found.append(f"trolley {trolley}: mean {name} {mean:.2f}, more than {limit:g}")
    return found


def fault_of(config: Config, docking: Docking) -> str:
    """What is wrong with a docking; empty if nothing is."""
    if not docking.done:
        return docking.cause or (f"not locked in {docking.phase}")
    if not within(config, docking):
        error_cm, most_cm = docking.metrics.get("e_y_cm", math.nan), 100 * bound_m(config, docking.trolley)
        return f"e_y {error_cm:.1f} cm, more than {most_cm:.0f} cm"
    return "false lock on the way" if docking.false_locks else ""


def within(config: Config, docking: Docking) -> bool:
    """Whether the lateral error is within the bound of its trolley."""
    return docking.metrics.get("e_y_cm", math.inf) <= 100 * bound_m(config, docking.trolley)


def bound_m(config: Config, trolley: int) -> float:
    """On the lateral error."""
    docking = config.docking
    return docking.lateral_bound_first_m if trolley == 1 else docking.lateral_bound_next_m


def image_bound(config: Config, trolley: int) -> tuple[float, float]:
    """Mean |e_y| [cm] and |e_θ| [°] that the array's image at goal ``trolley`` allows: it gets smaller with each."""
    goal = config.docking.goal(trolley)
    sigma = config.estimator.pixel_sigma_px / config.camera.lens.fx_px
    jacobian = feature_jacobian(config.leds.points, goal, config.camera.mount)
    covariance = np.linalg.inv(jacobian.T @ jacobian) * sigma**2
    # y of {F} in {L} is x sin θ − y cos θ of the relative pose
    lateral = np.array([0.0, -1.0, goal.x_m])
    mean = math.sqrt(2.0 / math.pi / AVERAGED_FRAMES)
    sigma_m = math.sqrt(float(lateral @ covariance @ lateral))
    return 100.0 * mean * sigma_m, math.degrees(mean * math.sqrt(float(covariance[2, 2])))
