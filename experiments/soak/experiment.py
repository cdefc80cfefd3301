"""``davpc experiment soak``: collections for hours in stepped time, with a recoverable fault in most dockings.

Shifts of half an hour go over the workers; each is kept in the results' folder as it ends, and the same call goes on
where it stopped. Everything in the results depends on the seed alone, but the memory.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from common.config import Config
from experiments.shared.executor import Workers, run_all
from experiments.shared.results import missed_note, row, write_results
from experiments.shared.unfinished import Unfinished, file_of, finished
from experiments.soak.resources import slope_per_h
from experiments.soak.shift import FAULT_SHARE, TRIES, TROLLEYS, Docked, Shift, Worked, work

SHIFT_S = 1800.0
# collections of a shift after which a process has made everything that it keeps
WARM_UP = 3
# of a process that simulates everything; hours of stepped time are minutes of its own
MOST_MB_PER_H = 5.0
# fewer are not judged: an allocator gives back some 10 MB now and then
JUDGED_SHIFTS = 4


def run(out: Path, seed: int, workers: Workers, config: Config, hours: float = 24.0) -> dict[str, Any]:
    """Soak for ``hours`` simulated hours; write ``results.json`` and ``table.md``.

    Args:
        out: folder for the results; what an interrupted call left there is taken up.
        seed: random seed of starts, worlds and faults.
        workers: who does the shifts.
        config: the robots.
        hours: simulated hours.
    """
    todo = shifts(config, seed, hours)
    files = {job.seed: Unfinished(file_of(out, f"shift-{job.seed}", job), Worked) for job in todo}
    kept = {number: done for number, file in files.items() if (done := file.read())}

    def keep(job: Shift, worked: Worked) -> None:
        kept[job.seed] = [worked]
        files[job.seed].keep([worked])

    run_all(work, [job for job in todo if job.seed not in kept], workers, "soak", keep=keep)
    results = _write(out, seed, config, hours, [kept[job.seed][0] for job in todo])
    finished(file.file for file in files.values())
    return results


def shifts(config: Config, seed: int, hours: float) -> list[Shift]:
    """Equal shifts of at most half an hour."""
    count = math.ceil(3600.0 * hours / SHIFT_S)
    text = config.model_dump_json()
    return [Shift(config_text=text, seed=100_000 * seed + i, seconds=3600.0 * hours / count) for i in range(count)]


def _write(out: Path, seed: int, config: Config, hours: float, done: Sequence[Worked]) -> dict[str, Any]:
    trolleys = [each for worked in done for each in worked.trolleys]
    names = sorted({each.fault for each in trolleys})
    rows = [row("all", "", len(trolleys), counted(trolleys))]
    rows += [row(name or "no fault", "", len(mine), counted(mine))
             for name in names if (mine := [each for each in trolleys if each.fault == name])]  # fmt: skip
    slopes = [slope for worked in done if (slope := memory_slope(worked)) is not None]
    growth, spread = float(np.mean(slopes)) if slopes else None, math.inf
    if len(slopes) >= JUDGED_SHIFTS:
        spread = float(np.std(slopes, ddof=1)) / math.sqrt(len(slopes))
    rows.append(row("memory", "of a process, after warm-up", len(slopes), {"mb_per_h": growth}))
    wrong = [line for each in trolleys for line in each.wrong]
    if growth is not None and growth - 2.0 * spread > MOST_MB_PER_H:
        wrong.append(f"memory grows by {growth:.1f} MB in a simulated hour, more than {MOST_MB_PER_H:g}")
    causes = dict(sorted(Counter(end.partition(":")[0] for each in trolleys for end in each.ends).items()))
    settings = {
        "hours": hours,
        "simulated_s": sum(worked.seconds for worked in done),
        "trolleys": TROLLEYS,
        "tries": TRIES,
        "fault_share": FAULT_SHARE,
        "causes": causes,
        "not_docked": [f"{asdict(each)}" for each in trolleys if not each.docked],
        "missed": wrong,
    }
    note = f"{_causes(causes)}\n\n{missed_note(wrong)}"
    return write_results(out, "soak", seed, settings, rows, [], config, note)


def counted(trolleys: Sequence[Docked]) -> dict[str, float | None]:
    """Metrics of some trolleys: counts, and shares of all."""
    n = len(trolleys)
    first = sum(each.docked and len(each.ends) == 1 for each in trolleys)
    docked = sum(each.docked for each in trolleys)
    return {
        "docked": docked,
        "docked_share": docked / n if n else None,
        "first_try_share": first / n if n else None,
        "tries": sum(len(each.ends) for each in trolleys) / n if n else None,
        "unsafe": sum(bool(each.unsafe) for each in trolleys),
        "unnamed": sum(len(each.wrong) - len(each.unsafe) for each in trolleys),
    }


def memory_slope(worked: Worked) -> float | None:
    """Growth of a shift's process [MB per simulated hour]; None where the shift was too short."""
    warm = worked.memory[WARM_UP:]
    return slope_per_h([t_s for t_s, _ in warm], [mb for _, mb in warm])


def _causes(causes: dict[str, int]) -> str:
    lines = ["| end of a try | times |", "|---|---|", *(f"| {name} | {count} |" for name, count in causes.items())]
    return "\n".join(lines)
