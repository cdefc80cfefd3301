"""``davpc bench recording``: what recorder and journals cost, in dockings with and without them in turn.

``run`` writes ``results.json``, ``table.md`` and the recordings: image → CAN [ms], the share of a core [%] that the
robots' processes take with the recorder on and off, what the recorder takes, and MB per docking.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from common.channels import DRIVES
from common.config import Config
from common.messages import Drives, MessageError, decode
from common.processes import RECORDER
from common.timing import NS_PER_MS, NS_PER_S, MonotonicClock
from experiments.shared.fleet import Fleet
from experiments.shared.results import row, write_results

MOST_ADDED_MS, MOST_ADDED_SHARE, MOST_RECORDER_PERCENT = 1.0, 0.10, 8.0
_START = "world.start=[2.0, 0.1, 1.0]"
_DOCKING_S = 90.0
_WORLD = "world"
Progress = Callable[[str], None]


@dataclass
class Measured:
    """What dockings of one kind came to."""

    image_to_can_ms: list[float] = field(default_factory=list)
    robots_percent: list[float] = field(default_factory=list)
    recorder_percent: list[float] = field(default_factory=list)
    file_mb: list[float] = field(default_factory=list)
    docked: int = 0

    def metrics(self) -> dict[str, float | None]:
        """For the table."""
        p50, p99 = (float(np.percentile(self.image_to_can_ms, q)) if self.image_to_can_ms else None for q in (50, 99))
        return {
            "image_to_can_p50_ms": p50,
            "image_to_can_p99_ms": p99,
            "robots_cpu_percent": _mean(self.robots_percent),
            "recorder_cpu_percent": _mean(self.recorder_percent),
            "mb_per_docking": _mean(self.file_mb),
            "docked": float(self.docked),
        }


def run(out: Path, config: Config, config_path: Path, pairs: int, progress: Progress = print) -> dict[str, Any]:
    """Measure.

    Args:
        out: folder for the results; made if missing.
        config: for the results.
        config_path: of the robots.
        pairs: dockings with, and as many without.
        progress: shows a line.

    Raises:
        DeviceError: a process died, or a docking did not begin.
    """
    out.mkdir(parents=True, exist_ok=True)
    measured = {"off": Measured(), "on": Measured()}
    for number in range(2 * pairs):
        # off on, on off, …: what drifts on this machine meets both alike
        kind = ("off", "on")[(number + number // 2) % 2]
        _docking(out, config_path, number, measured[kind], recorded=kind == "on")
        progress(f"docking {number + 1} of {2 * pairs}, recorder {kind}: {_short(measured[kind].metrics())}")
    rows = [row("recorder", kind, pairs, found.metrics()) for kind, found in measured.items()]
    missed = misses(measured["off"].metrics(), measured["on"].metrics())
    settings = {"pairs": pairs, "missed": missed, "cores": os.cpu_count()}
    note = "\n".join(missed) or "None missed."
    return write_results(out, "bench_recording", 1, settings, rows, [], config, note)


def misses(off: dict[str, float | None], on: dict[str, float | None]) -> list[str]:
    """Which limits are exceeded."""
    found = []
    before, after = off["image_to_can_p99_ms"], on["image_to_can_p99_ms"]
    if before is None or after is None:
        found.append("image → CAN was not measured")
    elif after - before > max(MOST_ADDED_MS, MOST_ADDED_SHARE * before):
        found.append(f"image → CAN p99 {after:.2f} ms with the recorder, {before:.2f} ms without")
    share = on["recorder_cpu_percent"]
    if share is None or share > MOST_RECORDER_PERCENT:
        shown = "not measured" if share is None else f"{share:.1f} % of a core"
        found.append(f"the recorder takes {shown}, limit {MOST_RECORDER_PERCENT:g} %")
    return found


def _docking(out: Path, config_path: Path, number: int, measured: Measured, *, recorded: bool) -> None:
    """One docking of fresh processes."""
    logs, folder = out / "logs", (out / "recordings").resolve()
    logs.mkdir(exist_ok=True)
    overrides = [_START, f"world.seed={1 + number // 2}", f"recorder.journal={str(recorded).lower()}"]
    overrides.append(f'recorder.directory="{folder}"')
    before = set(folder.glob("*.mcap"))
    with Fleet(config_path, logs, overrides) as fleet:
        if recorded:
            fleet.start(RECORDER)
            fleet.wait(fleet.all_alive, 40.0, "the recorder is not ready")
        watch = _ImageToCan(measured.image_to_can_ms)
        fleet.bus.stream(DRIVES, watch.take)
        fleet.ask("start")
        fleet.wait(lambda: fleet.mission is not None and fleet.mission.phase == "approach", 30.0, "no approach")
        begun, clock = _cpu_s(fleet), MonotonicClock()
        begun_ns = clock.now_ns()
        watch.on = True
        fleet.wait(lambda: _phase(fleet) != "approach", _DOCKING_S, "the approach does not end")
        watch.on = False
        lasted_s = (clock.now_ns() - begun_ns) / NS_PER_S
        spent = {name: 100 * (after - begun.get(name, after)) / lasted_s for name, after in _cpu_s(fleet).items()}
        measured.robots_percent.append(sum(p for name, p in spent.items() if name not in (RECORDER, _WORLD)))
        if recorded:
            measured.recorder_percent.append(spent[RECORDER])
        fleet.wait(lambda: _phase(fleet) in ("done", "aborted"), _DOCKING_S, "the docking does not end")
        measured.docked += _phase(fleet) == "done"
        if recorded:
            fleet.wait(lambda: bool(_complete(folder) - before), 20.0, "no recording is completed")
    measured.file_mb += [path.stat().st_size / 1e6 for path in _complete(folder) - before]


class _ImageToCan:
    """Collects image → CAN of each command while ``on``."""

    def __init__(self, found_ms: list[float]) -> None:
        self._found_ms, self._sequence, self.on = found_ms, 0, False

    def take(self, payload: bytes) -> None:
        try:
            drives: Drives = decode(Drives, payload)[1]
        except MessageError:
            return
        if self.on and drives.command_sequence != self._sequence and drives.image_to_can_ns:
            self._found_ms.append(drives.image_to_can_ns / NS_PER_MS)
        self._sequence = drives.command_sequence


def _phase(fleet: Fleet) -> str:
    return fleet.mission.phase if fleet.mission is not None else ""


def _complete(folder: Path) -> set[Path]:
    return {path for path in folder.glob("*.mcap") if not path.name.endswith(".part.mcap")}


def _cpu_s(fleet: Fleet) -> dict[str, float]:
    """CPU time of each process [s]."""
    return {name: _spent_s(child.pid) for name, child in fleet.children.items()}


def _spent_s(pid: int) -> float:
    words = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rsplit(")", 1)[1].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def _short(metrics: dict[str, float | None]) -> str:
    return ", ".join(f"{name} {value:.1f}" for name, value in metrics.items() if value is not None)


def _mean(values: list[float]) -> float | None:
    return float(np.mean(values)) if values else None
