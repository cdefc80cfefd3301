"""The end of a docking for people and programs: result table, ``results.json`` and pictures."""

from __future__ import annotations

import os
import platform
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from experiments.results import write_json
from station.record import DockingRecord

# the paper's mean for the first trolley on the real robots, its Table I row for the rest
_PAPER = {
    "e_y_cm": "1.69",
    "e_theta_deg": "0.84",
    "e_x_cm": "1.431",
    "e_p_px": "1.476",
    "m_v": "0.010",
    "m_w": "0.057",
}
# what a run leaves in its folder, beside its logs
OUTPUTS = ("results.json", "trajectory.png", "timeseries.png", "camera_frame.png")
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


def write_results(record: DockingRecord, cause: str, settings: dict[str, Any], out: Path) -> dict[str, Any]:
    """Write ``results.json`` to ``out`` and return its content, None for what is no number."""
    results = {**record.results(cause), "settings": settings, "machine": machine()}
    out.mkdir(parents=True, exist_ok=True)
    return write_json(out / "results.json", results)


def print_results(results: dict[str, Any], console: Console) -> None:
    """The result table."""
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


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}" if abs(value) < 10 else f"{value:.1f}"
