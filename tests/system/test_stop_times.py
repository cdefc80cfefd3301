"""The stop times' experiment with real processes: one trial of each fault, on the bench that measures hundreds."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from experiments.stop_times.experiment import METHODS, NAMES, ROBOT_METHODS, run

pytestmark = pytest.mark.alone


def test_each_fault_stops_the_wheels_in_its_time(tmp_path: Path) -> None:
    lines: list[str] = []
    results = run(tmp_path, trials=1, stalls=1, progress=lines.append)
    assert json.loads((tmp_path / "results.json").read_text()) == results
    rows = {row["method"]: row for row in results["rows"]}
    assert tuple(rows) == NAMES
    assert len(lines) == len(rows)
    for method in (*METHODS, *ROBOT_METHODS):
        assert 0.0 < rows[method.name]["metrics"]["max_ms"] <= method.limit_ms
        assert rows[method.name]["frames_moving_after_stop"] == 0
    assert rows["stall"]["metrics"] == {"stale_setpoints": 0}
