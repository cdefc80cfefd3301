"""The end of a docking for people and programs: result table, ``results.json`` and pictures."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from common.files.writer import write_json
from station.simulate.record import DockingRecord

Memory = dict[str, list[tuple[float, float]]]
# the paper's mean for the first trolley on the real robots, its Table I row for the rest
_PAPER = {
    "e_y_cm": "1.69",
    "e_theta_deg": "0.84",
    "e_x_cm": "1.431",
    "e_p_px": "1.476",
    "m_v": "0.010",
    "m_w": "0.057",
}
RESULTS = "results.json"
# from when all is warm to the end of a run; samples of resident memory scatter by less
_FLAT_MB = 5.0
# what runs leave in their folder, beside their logs
OUTPUTS = (RESULTS, "trajectory*.png", "timeseries*.png", "camera_frame*.png", "collection.png", "run*.mcap")
_LABELS = {
    "e_x_cm": "e_x  normal error, cm",
    "e_y_cm": "e_y  lateral error, cm",
    "e_theta_deg": "e_θ  heading error, °",
    "e_p_px": "e_p  features, px",
    "m_v": "M_v  smoothness, m/s",
    "m_w": "M_ω  smoothness, rad/s",
    "duration_s": "duration, s",
}


def machine() -> dict[str, Any]:
    """Where a figure was measured."""
    return {"cores": os.cpu_count(), "system": platform.system(), "python": platform.python_version()}


def write_results(
    records: Sequence[DockingRecord], cause: str, memory_mb: Memory, settings: dict[str, Any], out: Path
) -> dict[str, Any]:
    """Write ``results.json``, with null for what is no number.

    Args:
        records: of the dockings.
        cause: what ended the run early; "" for nothing.
        memory_mb: resident memory of each process by time.
        settings: of the run.
        out: folder.

    Returns:
        The content: of one docking itself, of several an entry of ``trolleys`` each.
    """
    last = len(records) - 1
    rows = [record.results(cause if i == last else "") for i, record in enumerate(records)]
    if settings["trolleys"] == 1:
        content = rows[0]
    else:
        complete = len(rows) == settings["trolleys"] and all(row["connected"] for row in rows)
        content = {"connected": complete, "cause": rows[-1]["cause"], "trolleys": rows}
    if memory_mb:
        content = {**content, "memory_mb": {name: _memory(samples) for name, samples in memory_mb.items() if samples}}
    content = {**content, "settings": settings, "machine": machine()}
    out.mkdir(parents=True, exist_ok=True)
    return write_json(out / RESULTS, content)


def _memory(samples: list[tuple[float, float]]) -> dict[str, Any]:
    """Resident memory at a quarter of the run, when all is warm, and at its end; the samples by time."""
    return {"quarter": samples[len(samples) // 4][1], "end": samples[-1][1], "samples": samples}


def print_results(results: dict[str, Any], console: Console) -> None:
    """The result table: of one docking in full, of several a row for each."""
    if "trolleys" in results:
        _print_collection(results, console)
        return
    docked = results["connected"]
    title = "[green]docked: trolley locked, Follower retracted" if docked else f"[red]not docked: {results['cause']}"
    table = Table(title=title, title_justify="left")
    table.add_column("")
    table.add_column("this run", justify="right")
    table.add_column("paper", justify="right", style="dim")
    for key, label in _LABELS.items():
        table.add_row(label, _number(results["metrics"][key]), _PAPER.get(key, ""))
    frames, latency = results["frames"], results["image_to_can_ms"]
    table.add_row("frames seen / dropped", f"{frames['seen']} / {frames['dropped']}", "")
    table.add_row("image → CAN p50 / p99, ms", f"{_number(latency['p50'])} / {_number(latency['p99'])}", "")
    table.add_row("control rate, Hz", _number(results["control_hz"]), "20")
    phases = "  ".join(f"{name} {seconds:.1f}" for name, seconds in results["phases_s"].items())
    table.add_row("phases, s", phases, "")
    console.print(table)


def _print_collection(results: dict[str, Any], console: Console) -> None:
    rows, wanted = results["trolleys"], results["settings"]["trolleys"]
    count = sum(row["connected"] for row in rows)
    text = f"{count} of {wanted} trolleys docked and locked"
    title = f"[green]{text}" if results["connected"] else f"[red]{text}: {results['cause']}"
    table = Table(title=title, title_justify="left")
    for heading in ("trolley", "e_x cm", "e_y cm", "e_θ °", "e_p px", "duration s", "image → CAN p99 ms", "ended"):
        table.add_column(heading, justify="right")
    for row in rows:
        metrics = row["metrics"]
        cells = [metrics[key] for key in ("e_x_cm", "e_y_cm", "e_theta_deg", "e_p_px", "duration_s")]
        ended = "locked" if row["connected"] else row["cause"]
        latency = _number(row["image_to_can_ms"]["p99"])
        table.add_row(str(row["trolley"]), *map(_number, cells), latency, ended)
    console.print(table)
    memory = results.get("memory_mb", {})
    if memory:
        sizes = [f"{name} {m['quarter']:.0f} → {m['end']:.0f}" for name, m in memory.items()]
        console.print(f"resident memory, MB, at a quarter of the run → at its end: {', '.join(sizes)}")
        grown = [name for name, m in memory.items() if m["end"] - m["quarter"] > _FLAT_MB]
        flat = f"[green]memory is flat: no process grew by more than {_FLAT_MB:g} MB"
        console.print(f"[red]memory is not flat: more than {_FLAT_MB:g} MB in {', '.join(grown)}" if grown else flat)


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}" if abs(value) < 10 else f"{value:.1f}"
