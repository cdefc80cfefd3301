"""Many runs by several workers."""

from __future__ import annotations

import io
import os

import pytest
from rich.console import Console

from experiments.shared.campaign import run_all


def test_workers_give_linear_algebra_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    names = ["OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"]
    assert run_all(os.getenv, names, 2, "threads") == ["1", "1"]
    assert [os.getenv(name) for name in names] == ["3", None]


def test_a_log_shows_the_progress_and_the_time_left_at_every_tenth() -> None:
    log = io.StringIO()
    assert run_all(abs, list(range(-40, 0)), 1, "many", Console(file=log, width=120)) == list(range(40, 0, -1))
    lines = [line for line in log.getvalue().splitlines() if " min left" in line]
    assert len(lines) == 10
    assert lines[0].startswith("many: 4 of 40 after 0.0 min")
    assert "40 of 40" in lines[-1]
