"""The paper's real-world scenarios, simulated down to pixels and CAN frames: ``davpc experiment scenarios``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from common.config import Config
from experiments.queues.plots import draw_scenarios
from experiments.queues.run import Docking, plan, run_plan
from experiments.queues.sequential import LOAD_KG, fault_of, metrics_of
from experiments.shared.executor import Workers, run_all
from experiments.shared.results import missed_note, row, write_results


@dataclass(frozen=True)
class Scenario:
    """Where, which trolley, and from where [m, m, °]; starts vary by 0.3 m, 0.15 m and 5° to each side."""

    name: str
    scene: str
    trolley: int
    start: tuple[float, float, float]


SCENARIOS = {
    scenario.name: scenario
    for scenario in (
        Scenario("dark_outdoor", "dark_outdoor", 1, (6.0, 2.0, 0.0)),
        Scenario("parking_lot", "parking_lot", 2, (6.0, -1.0, 10.0)),
        Scenario("glass_hall", "glass_hall", 5, (8.0, 0.5, 0.0)),
    )
}
SPREAD = (0.3, 0.15, 5.0)


@dataclass(frozen=True)
class ScenarioJob:
    """One docking in a scenario."""

    config_text: str
    scenario: Scenario
    seed: int
    trial: int


def run(
    out: Path,
    seed: int,
    workers: Workers,
    config: Config,
    trials: int = 20,
    cases: tuple[str, ...] = tuple(SCENARIOS),
) -> dict[str, Any]:
    """Dock ``trials`` times in each scenario; write ``results.json``, ``table.md``, ``scenarios.png``.

    Args:
        out: folder to write to.
        seed: random seed of scenes, starts, loads and noise; the results do not depend on ``workers``.
        workers: who does the runs.
        config: the robots.
        cases: of :data:`SCENARIOS`.
    """
    text = config.model_dump_json()
    todo = [ScenarioJob(text, SCENARIOS[name], seed, trial) for name in cases for trial in range(trials)]
    dockings = run_all(scenario_job, todo, workers, "scenarios")
    rows, missed = [], []
    for i, name in enumerate(cases):
        mine = dockings[i * trials : (i + 1) * trials]
        rows.append(row("davpc", f"{name}, trolley {SCENARIOS[name].trolley}", trials, metrics_of(config, mine)))
        missed += [f"{name}, trial {k}: {fault}" for k, d in enumerate(mine) if (fault := fault_of(config, d))]
    settings = {
        "trials": trials,
        "starts": {name: SCENARIOS[name].start for name in cases},
        "spread": SPREAD,
        "missed": missed,
    }
    results = write_results(out, "scenarios", seed, settings, rows, [], config, missed_note(missed))
    first = {todo[i].scenario.name: (world_changes(todo[i]), dockings[i]) for i in range(0, len(todo), trials)}
    draw_scenarios(first, config, out)
    return results


def world_changes(job: ScenarioJob) -> dict[str, Any]:
    """What of ``[world]`` is the scenario's: scene, start and seed."""
    draws = np.random.default_rng((job.seed, job.trial, len(job.scenario.name)))
    start = [float(s + draws.uniform(-w, w)) for s, w in zip(job.scenario.start, SPREAD, strict=True)]
    return {"scene": job.scenario.scene, "start": start, "seed": int(draws.integers(2**31))}


def scenario_job(job: ScenarioJob) -> Docking:
    """One docking; the first of each scenario with its trace."""
    config = Config.model_validate_json(job.config_text)
    changes = {**world_changes(job), "trolley_load_kg": LOAD_KG}
    docking = run_plan(plan(config, first=job.scenario.trolley, traced=job.trial == 0, **changes))[-1]
    docking.commands.clear()
    return docking
