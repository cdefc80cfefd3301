"""Many runs by several workers: the same results in order, and nothing lost."""

from __future__ import annotations

import io
import os
from pathlib import Path

import pytest
from rich.console import Console

from common.errors import DeviceError
from experiments.shared.executor import ALONE, Workers, run_all
from tests.rigs.runs import fails, lost, lost_once, noise

SILENT = Console(file=io.StringIO())


def test_workers_give_linear_algebra_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    names = ["OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"]
    assert run_all(os.getenv, names, Workers(2), "threads", SILENT) == ["1", "1"]
    assert [os.getenv(name) for name in names] == ["3", None]


def test_a_log_gets_the_progress_and_the_time_left_at_every_tenth() -> None:
    log = io.StringIO()
    assert run_all(abs, list(range(-40, 0)), ALONE, "many", Console(file=log, width=120)) == list(range(40, 0, -1))
    lines = [line for line in log.getvalue().splitlines() if " min left" in line]
    assert len(lines) == 10
    assert lines[0].startswith("many: 4 of 40 after 0.0 min")
    assert "40 of 40" in lines[-1]


def test_results_are_in_order_and_identical_to_the_bit_at_any_number_of_jobs() -> None:
    kept: dict[int, list[float]] = {}
    many = run_all(noise, list(range(12)), Workers(3), "noise", SILENT, kept.__setitem__)
    assert many == run_all(noise, list(range(12)), Workers(2), "noise", SILENT) == [kept[seed] for seed in range(12)]


def test_a_run_that_lost_its_process_is_repeated_and_not_for_ever(tmp_path: Path) -> None:
    markers = [str(tmp_path / name) for name in "ab"]
    assert run_all(lost_once, markers, Workers(2), "lost once", SILENT) == ["done", "done"]
    with pytest.raises(DeviceError, match="lost its process 3 times"):
        run_all(lost, [1, 2, 3], Workers(2), "lost", SILENT)


def test_an_error_of_a_run_ends_the_experiment_with_the_traceback_of_its_process() -> None:
    with pytest.raises(ZeroDivisionError) as caught:
        run_all(fails, [1, 0, 1], Workers(2), "fails", SILENT)
    assert "return 1 // value" in "".join(caught.value.__notes__)


def test_no_job_is_no_number_of_jobs() -> None:
    with pytest.raises(ValueError, match="at least one"):
        Workers(0)
