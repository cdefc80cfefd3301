"""The loads side by side: ages against their limits, and the periods that each process missed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from experiments.load.watch import LIMITS_NS

_MARKS = "os^D"


def draw_loads(results: dict[str, Any], path: Path) -> None:
    """Left: the largest age as a share of its limit; right: missed periods by process."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows = results["rows"]
    names = [entry["method"] for entry in rows]
    figure = Figure(figsize=(12, 0.55 * len(names) + 2.2), layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2)
    places = np.arange(len(names))
    for mark, (what, limit_ns) in zip(_MARKS, LIMITS_NS.items(), strict=True):
        shares = [(entry["metrics"][f"{what} ms"] or np.nan) / (limit_ns / 1e6) for entry in rows]
        left.plot(shares, places, mark, label=f"{what}, limit {limit_ns / 1e6:g} ms", fillstyle="none", color="black")
    left.axvline(1.0, color="black", linewidth=1)
    left.set_xscale("log")
    left.set_xlabel("largest age or gap, in limits")
    left.set_yticks(places, names)
    left.invert_yaxis()
    left.legend(fontsize=8, loc="best")
    missed = results["settings"]["missed_periods"]
    processes = sorted({process for each in missed.values() for process in each})
    table = np.array([[missed[name].get(process, 0) for process in processes] for name in names], dtype=float)
    right.imshow(np.log10(1.0 + table), cmap="Greys", aspect="auto", vmax=np.log10(1.0 + max(table.max(), 100.0)))
    right.set_xticks(range(len(processes)), processes, rotation=35, ha="right", fontsize=8)
    right.set_yticks(places, names)
    right.set_title("missed periods", fontsize=10)
    for (y, x), count in np.ndenumerate(table):
        right.text(x, y, f"{count:g}", ha="center", va="center", fontsize=8, color="white" if count > 50 else "black")
    figure.savefig(path, dpi=110)
