"""``davpc experiment soak --real MINUTES``: real processes, and what they hold, sampled once a second.

``results.json``: a row per process. Memory has a limit once the time is long enough to see it; descriptors and
threads must stay as they were after the warm-up.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from common.config import default_config_path, load_config
from common.processes import process
from experiments.shared.fleet import Fleet
from experiments.shared.operator import Operator
from experiments.shared.results import missed_note, row, write_results
from experiments.soak.resources import Held, held, slope_per_h

MOST_MB_PER_H = 1.0
# below, the slope is written down but not judged: a page more or less would be several MB in an hour
JUDGED_MINUTES = 20.0
WARM_UP_SHARE = 0.25
_PERIOD_S, _LOOK_S = 1.0, 0.05
_REPORT_EVERY_S = 60.0
History = dict[str, list[Held]]
Missed = dict[str, int]


def run(
    out: Path, config_path: Path | None, minutes: float, overrides: Sequence[str], progress: Callable[[str], None]
) -> dict[str, Any]:
    """Dock for that long; write ``results.json`` and ``table.md``.

    Args:
        out: folder for the results and the logs.
        config_path: TOML file of the pair; None: the reference.
        minutes: without the start of the processes.
        overrides: of the configuration.
        progress: takes a line a minute.
    """
    path = config_path or default_config_path()
    config = load_config(path, overrides)
    logs = out / "logs"
    logs.mkdir(parents=True, exist_ok=True)
    operator = Operator()
    with Fleet(path, logs, overrides) as fleet:
        history, missed, died = _watch(fleet, operator, 60.0 * minutes, progress)
    warm_s = 60.0 * minutes * WARM_UP_SHARE
    rows = [
        row(name, "process", len(mine), counted(mine, warm_s, missed.get(name, 0))) for name, mine in history.items()
    ]
    wrong = [*died, *judged(history, warm_s, minutes)]
    if operator.given_up or not operator.ends:
        wrong.append(f"no docking any more: {operator.given_up or 'none ended'}")
    settings = {
        "minutes": minutes,
        "warm_up_s": warm_s,
        "dockings": dict(operator.ends),
        "missed_share": {name: missed[name] / process(name).rate_hz / (60.0 * minutes - warm_s) for name in missed},
        "missed": wrong,
    }
    return write_results(out, "soak_real", 0, settings, rows, [], config, missed_note(wrong))


def _watch(
    fleet: Fleet, operator: Operator, seconds: float, progress: Callable[[str], None]
) -> tuple[History, Missed, list[str]]:
    """Samples of each process, the periods that it missed after the warm-up, and those that ended by themselves."""
    history: History = {name: [] for name in fleet.children}
    begin = time.monotonic()
    missed_before: Missed = {}
    due_s, report_s = 0.0, _REPORT_EVERY_S
    while (now_s := time.monotonic() - begin) < seconds:
        fleet.operate(operator, now_s)
        if now_s >= due_s:
            due_s += _PERIOD_S
            for name, child in fleet.children.items():
                if child.poll() is not None:
                    return history, {}, [f"process {name} ended after {now_s:.0f} s, see its log"]
                history[name].append(held(child.pid, now_s))
            if now_s < seconds * WARM_UP_SHARE:
                missed_before = {name: health.missed_periods for name, health in fleet.health.items()}
        if now_s >= report_s:
            report_s += _REPORT_EVERY_S
            progress(
                f"soak: {now_s / 60:.0f} min, {(seconds - now_s) / 60:.0f} min left, {operator.ends['done']} docked"
            )
        time.sleep(_LOOK_S)
    missed = {name: health.missed_periods - missed_before.get(name, 0) for name, health in fleet.health.items()}
    return history, missed, []


def counted(samples: Sequence[Held], warm_s: float, missed_periods: int) -> dict[str, float | None]:
    """Metrics of one process after its warm-up."""
    warm = [sample for sample in samples if sample.t_s >= warm_s]
    return {
        "mb": warm[-1].resident_mb if warm else None,
        "mb_per_h": slope_per_h([s.t_s for s in warm], [s.resident_mb for s in warm]),
        "descriptors": warm[-1].descriptors if warm else None,
        "descriptors_more": warm[-1].descriptors - warm[0].descriptors if warm else None,
        "threads": warm[-1].threads if warm else None,
        "threads_more": warm[-1].threads - warm[0].threads if warm else None,
        "missed_periods": missed_periods,
    }


def judged(history: Mapping[str, Sequence[Held]], warm_s: float, minutes: float) -> list[str]:
    """What grows that must not, a line each."""
    wrong = []
    for name, samples in history.items():
        metrics = counted(samples, warm_s, 0)
        slope = metrics["mb_per_h"]
        if slope is not None and slope > MOST_MB_PER_H and minutes >= JUDGED_MINUTES:
            wrong.append(f"{name}: memory grows by {slope:.1f} MB/h, more than {MOST_MB_PER_H:g}")
        wrong += [f"{name}: {metrics[f'{what}_more']:+.0f} {what}"
                  for what in ("descriptors", "threads") if metrics[f"{what}_more"]]  # fmt: skip
    return wrong
