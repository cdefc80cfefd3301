"""The campaign as a matrix, row × phase: in Markdown, and as a picture that can be read in grey."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from experiments.campaign.rows import ROWS
from experiments.campaign.trunk import PHASES

_COUNTS = (("unsafe", "U"), ("wrong_reaction", "R"), ("wrong_cause", "C"), ("late", "L"))
_LEGEND = (
    "A cell: runs, and the longest time to the reaction in ms. What is not right stands in bold: "
    "**U** unsafe motion, **R** wrong reaction, **C** wrong cause, **L** late, each with its count."
)


def matrix(entries: Sequence[dict[str, Any]], rows: Sequence[str], measured: Sequence[dict[str, Any]] = ()) -> str:
    """The table of all rows, with the longest times; below it those measured with real processes."""
    cells = {(entry["method"], entry["case"]): entry for entry in entries}
    lines = ["# campaign", "", _LEGEND, "", f"| row | {' | '.join(PHASES)} | limit ms | fault and reaction | by |"]
    lines.append("|---|" + "---|" * (len(PHASES) + 3))
    for name in rows:
        known = ROWS[name]
        middle = [_cell(cells.get((name, phase))) for phase in PHASES]
        limit = "" if known.limit_ms is None else f"{known.limit_ms:g}"
        lines.append(f"| {name} | {' | '.join(middle)} | {limit} | {known.what} | {known.process or '–'} |")
    runs = sum(entry["n"] for entry in entries)
    red = sum(_red(entry) for entry in entries)
    lines += [f"\n{entry['method']} {entry['case']}: {_cell(entry)}" for entry in measured]
    lines += ["", f"{runs} runs in {len(cells)} cells, {red} of these not right."]
    return "\n".join(lines) + "\n"


def _red(entry: dict[str, Any]) -> bool:
    return any(entry["metrics"].get(name) for name, _ in _COUNTS)


def _marks(entry: dict[str, Any]) -> str:
    counts = ((letter, entry["metrics"].get(name)) for name, letter in _COUNTS)
    return " ".join(f"{letter}{count:g}" for letter, count in counts if count)


def _cell(entry: dict[str, Any] | None) -> str:
    if entry is None:
        return ""
    longest = entry["metrics"]["max_ms"]
    time = "" if longest is None else f", {longest:.0f}"
    marks = _marks(entry)
    return f"{entry['n']}{time}" + (f" **{marks}**" if marks else "")


def draw_matrix(entries: Sequence[dict[str, Any]], rows: Sequence[str], path: Path) -> None:
    """The same as a picture: white is right, dark and hatched is not; the longest time in each cell."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    cells = {(entry["method"], entry["case"]): entry for entry in entries}
    figure = Figure(figsize=(11, 1.2 + 0.27 * len(rows)), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    axis = figure.subplots()
    for y, name in enumerate(rows):
        for x, phase in enumerate(PHASES):
            entry = cells.get((name, phase))
            if entry is None:
                continue
            red = _red(entry)
            patch = Rectangle((x - 0.5, y - 0.5), 1, 1, edgecolor="0.3", lw=0.6)
            patch.set(facecolor="#c8442f" if red else "#f2f7f2", hatch="///" if red else "")
            axis.add_patch(patch)
            longest = entry["metrics"]["max_ms"]
            text = _marks(entry) if red else ("–" if longest is None else f"{longest:.0f}")
            box = {"facecolor": "white", "edgecolor": "none", "pad": 0.8} if red else None
            axis.text(x, y, text, ha="center", va="center", fontsize=7, weight="bold" if red else "normal", bbox=box)
        if ROWS[name].process and not any((name, phase) in cells for phase in PHASES):
            axis.text(0, y, f"by {ROWS[name].process}", va="center", fontsize=7, style="italic")
    axis.set(xlim=(-0.5, len(PHASES) - 0.5), ylim=(len(rows) - 0.5, -0.5))
    axis.set_xticks(range(len(PHASES)), PHASES, rotation=30, ha="left", fontsize=8)
    axis.set_yticks(
        range(len(rows)), [f"{name}  {ROWS[name].what.partition(':')[0][:46]}" for name in rows], fontsize=7
    )
    axis.xaxis.tick_top()
    axis.set_title("longest time to the reaction, ms; hatched: U unsafe, R reaction, C cause, L late", fontsize=9)
    figure.savefig(path)
