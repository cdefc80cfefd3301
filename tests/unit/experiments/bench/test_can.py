"""The bench of the bus runs and says what it says it does."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from experiments.bench.can import run


@pytest.mark.alone
def test_bench_writes_its_rows(tmp_path: Path) -> None:
    results = run(tmp_path, cycles=30)
    assert json.loads((tmp_path / "results.json").read_text()) == results
    rows = {row["method"]: row["metrics"] for row in results["rows"]}
    assert set(rows) == {"sdo_round_trip", "exchange", "lateness", "bridge_cpu"}
    assert 0.0 < rows["sdo_round_trip"]["p50_ms"] <= rows["sdo_round_trip"]["p99_ms"]
    assert rows["bridge_cpu"]["malformed"] == 0
