"""The approach without the link between the robots: ``davpc experiment linkcut``.

Each trial docks twice with the same seed, once with the link cut permanently at a random time of the approach. The
velocity commands must be bit-equal; the docking then ends with its named cause in the lock step, grippers closed.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from common.causes import cause_code
from common.config import Config
from common.timing import NS_PER_S
from experiments.queues.run import Accident, Backstage, Docking, plan, run_plan
from experiments.shared.executor import Workers, run_all
from experiments.shared.results import missed_note, row, write_results

START = ((4.0, 6.0), 1.0, 20.0)
EXPECTED_CAUSE = "leader_silent"


@dataclass(frozen=True)
class CutJob:
    """One pair of runs."""

    config_text: str
    seed: int
    trial: int


@dataclass(frozen=True)
class CutResult:
    """One pair: commands of the approach, how many differ, both ends, whether the trolley is still held."""

    cut_s: float
    commands: int
    different: int
    linked: str
    cut: str
    held: bool


def run(out: Path, seed: int, workers: Workers, config: Config, trials: int = 20) -> dict[str, Any]:
    """Run ``trials`` pairs; write ``results.json`` and ``table.md``.

    Args:
        out: folder to write to.
        seed: random seed; the results do not depend on ``workers``.
        workers: who does the runs.
        config: the robots.
        trials: pairs of runs.
    """
    todo = [CutJob(config.model_dump_json(), seed, trial) for trial in range(trials)]
    pairs = run_all(pair_job, todo, workers, "pairs")
    equal = [pair.commands > 0 and pair.different == 0 for pair in pairs]
    named = [pair.cut == EXPECTED_CAUSE and pair.held for pair in pairs]
    metrics = {
        "bit_equal": float(sum(equal)),
        "ended_by_name": float(sum(named)),
        "commands": float(sum(pair.commands for pair in pairs)),
        "different_commands": float(sum(pair.different for pair in pairs)),
    }
    missed = [f"trial {i}: {pair}" for i, pair in enumerate(pairs) if not (equal[i] and named[i])]
    settings = {"trials": trials, "start": START, "pairs": [vars(pair) for pair in pairs], "missed": missed}
    rows = [row("davpc", "link cut", trials, metrics)]
    return write_results(out, "linkcut", seed, settings, rows, [], config, missed_note(missed))


def pair_job(job: CutJob) -> CutResult:
    """Both runs."""
    config = Config.model_validate_json(job.config_text)
    draws = np.random.default_rng((job.seed, job.trial))
    (near, far), side, turn = START
    start = [float(draws.uniform(near, far)), float(draws.uniform(-side, side)), float(draws.uniform(-turn, turn))]
    share, world_seed = float(draws.uniform(0.05, 0.95)), int(draws.integers(2**31))
    what = plan(config, start=start, seed=world_seed)
    linked = run_plan(what)[-1]
    begin_s, end_s = _approach(linked)
    cut_s = begin_s + share * (end_s - begin_s)
    held: list[bool] = []
    cut = run_plan(what, _note_grip(held), round(cut_s * NS_PER_S))[-1]
    pairs = list(zip(linked.commands, cut.commands, strict=False))
    different = sum(a != b for a, b in pairs) + abs(len(linked.commands) - len(cut.commands))
    return CutResult(
        cut_s - begin_s,
        len(linked.commands),
        different,
        cause_code(linked.cause) or linked.phase,
        cause_code(cut.cause) or cut.phase,
        bool(held) and held[-1],
    )


def _approach(docking: Docking) -> tuple[float, float]:
    """When it began and ended."""
    starts = [start for phase, start in docking.phases_s if phase == "approach"]
    after = [start for phase, start in docking.phases_s if starts and start > starts[-1]]
    return (starts[0], after[0]) if starts and after else (0.0, 0.0)


def _note_grip(held: list[bool]) -> Accident:
    """No accident: only notes the grip."""

    def look(now_ns: int, phase: str, stage: Backstage) -> None:  # noqa: ARG001
        held.append(stage.world.plant.arms.holding)

    return look
