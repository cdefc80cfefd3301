"""What of a load must not be, and the picture of all of them."""

from __future__ import annotations

from pathlib import Path

from experiments.load.experiment import LOADS, Loaded, _row
from experiments.load.plot import draw_loads
from experiments.load.watch import GAP, LIMITS_NS


def loaded(**changes: object) -> Loaded:
    worst = {name: limit_ns / 2e6 for name, limit_ns in LIMITS_NS.items()}
    return Loaded("cpu", **{"worst_ms": worst, "missed": {"leader": 3}, **changes})  # type: ignore[arg-type]


def test_a_gap_is_a_stop_or_wrong_and_a_slow_recovery_and_a_death_are_wrong() -> None:
    assert loaded(recovery_s=0.9, worst_ms={GAP: 400.0}).wrong == []
    assert loaded(gaps_without_stop=2, worst_ms={GAP: 130.0}).wrong == [
        "cpu: 2 gaps in the commands without a stop, up to 130 ms"
    ]
    assert loaded(recovery_s=1.1, host_ms=60.0).wrong == [
        "cpu: back to normal only after 1.1 s (the host stood still for 60 ms)"
    ]
    assert loaded(died=["leader"]).wrong == ["cpu: process leader ended"]


def test_the_picture_shows_every_load(tmp_path: Path) -> None:
    each = loaded()
    rows = [{**_row(each), "method": name} for name in LOADS]
    results = {"rows": rows, "settings": {"missed_periods": dict.fromkeys(LOADS, each.missed)}}
    draw_loads(results, tmp_path / "load.png")
    assert (tmp_path / "load.png").stat().st_size > 10_000
