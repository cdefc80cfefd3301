"""Rows that are killed and stopped as real processes: ``davpc experiment campaign --processes``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from experiments.shared.results import row
from experiments.stop_times import experiment as stop_times

METHODS: dict[str, tuple[str, ...]] = {
    "S01": ("controller_kill",),
    "S02": ("controller_stop",),
    "S03": ("estimator_kill",),
    "S04": ("camera_kill",),
    "S05": ("supervisor_kill",),
    "S06": ("bridge_kill", "bridge_stop"),
    "S27": (stop_times.STALL,),
    "S49": ("arms_kill",),
}


def run(
    out: Path, config_path: Path | None, trials: int, seed: int, rows: Sequence[str], progress: Callable[[str], None]
) -> tuple[list[dict[str, Any]], list[str]]:
    """The rows that :mod:`experiments.stop_times` has, one row of results a method, and what is not right.

    Args:
        out: folder of the campaign.
        config_path: the robots; None: the default configuration.
        trials: of each fault of the controller; others get fewer, as there.
        seed: of the random moments.
        rows: ids of the campaign; those without a method here are left out.
        progress: takes one line a method.
    """
    names = tuple(name for row_id in rows for name in METHODS.get(row_id, ()))
    measured = stop_times.run(out / "processes", config_path, trials, max(1, trials // 2), seed, progress, names)
    row_of = {name: row_id for row_id, methods in METHODS.items() for name in methods}
    entries, missed = [], []
    for each in measured["rows"]:
        moved = each.get("frames_moving_after_stop", each["metrics"].get("stale_setpoints", 0))
        longest = each["metrics"].get("max_ms")
        late = longest is not None and longest > each["limit_ms"]
        counts = {"unsafe": int(moved > 0), "late": int(late), "max_ms": longest}
        entries.append(row(row_of[each["method"]], f"process: {each['method']}", each["n"], counts))
        if not each["passed"]:
            missed.append(
                f"{row_of[each['method']]} {each['method']}: {each['metrics']}, {moved} frames after the stop"
            )
    return entries, missed
