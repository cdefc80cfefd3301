"""Experiments: the same results for a seed at any number of jobs, in the agreed format, near the limit."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from common.config import default_config_path, load_config
from experiments import bench_control, disturbance, table1
from experiments.cramer_rao import bound
from experiments.pilots import PilotFactory
from experiments.results import markdown, row
from experiments.scenes import DISTURBANCES, DISTURBED_START, method_config, paper_start, random_pads
from experiments.sweep_settings import with_horizon, with_points
from experiments.trial import METRICS, fly, goal_task, summarise

CONFIG = load_config(default_config_path())


def test_a_run_is_the_same_to_the_bit() -> None:
    task = goal_task(method_config(CONFIG, "davpc"))
    factory, start = PilotFactory("davpc", task), paper_start(DISTURBED_START)
    first, second = (fly(task, factory.make(), start, [3, 0], DISTURBANCES["none"], 4.0) for _ in range(2))
    np.testing.assert_array_equal(first.trace.arrays()["command"], second.trace.arrays()["command"])
    np.testing.assert_array_equal(first.trace.arrays()["pose"], second.trace.arrays()["pose"])


def test_table1_writes_the_agreed_format_and_does_not_depend_on_jobs(tmp_path: Path) -> None:
    runs = [
        table1.run(tmp_path / str(jobs), 2, jobs, CONFIG, trials=2, methods=("ibvs",), cases=("T",))
        for jobs in (1, 2)
    ]
    written = json.loads((tmp_path / "1/results.json").read_text())
    assert runs[0] == runs[1] == written
    assert set(written) == {"experiment", "seed", "settings", "rows", "paper"}
    methods = [(entry["method"], entry["case"]) for entry in written["rows"]]
    assert methods == [("ibvs", "T")]
    assert set(METRICS) <= set(written["rows"][0]["metrics"])
    assert "| ibvs | T | 2 |" in (tmp_path / "1/table.md").read_text()
    assert written["paper"][2]["e_y_cm"] == 0.598


def test_table1_names_an_unknown_case(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="case 'X'"):
        table1.run(tmp_path, 1, 1, CONFIG, trials=1, methods=("ibvs",), cases=("X",))


def test_disturbance_draws_its_figure(tmp_path: Path) -> None:
    results = disturbance.run(tmp_path, 1, 1, CONFIG, trials=1, methods=("davpc",), cases=("yaw_pads",))
    assert (tmp_path / "disturbance.png").stat().st_size > 10_000
    assert [entry["case"] for entry in results["rows"]] == ["yaw_pads", "paper_pads"]
    assert results["rows"][0]["metrics"]["e_y_cm"] < 1.5


def test_default_method_is_near_the_information_limit() -> None:
    task = goal_task(method_config(CONFIG, "davpc"))
    outcome = fly(
        task, PilotFactory("davpc", task).make(), paper_start(DISTURBED_START), [1, 0], DISTURBANCES["none"]
    )
    limit = bound(task, outcome.trace)
    assert outcome.metrics["lost"] == outcome.metrics["over_bound"] == 0.0
    assert 0.05 < limit["e_y_cm"] < 0.3
    assert outcome.metrics["e_y_cm"] < 4 * limit["e_y_cm"]


def test_bench_counts_what_a_solver_leaves_unsolved_and_what_it_gets_wrong() -> None:
    setting = method_config(CONFIG, "paper")
    problems = bench_control.record_problems(setting, 8, 1)
    assert len(problems) == 8
    timing = bench_control.time_solver(setting, "gauss_newton", problems)
    assert timing.failures == timing.silent_failures == 0
    assert 0 < timing.median_ms <= timing.p99_ms <= timing.max_ms


def test_settings_change_what_they_say() -> None:
    assert with_horizon(CONFIG, 20).controller.realtime.knots[-1] == 19
    assert with_points(CONFIG, 6).leds.points.shape == (6, 3)
    assert random_pads(1) == random_pads(1) != random_pads(2)


def test_summary_counts_and_averages() -> None:
    one = dict.fromkeys(METRICS, 1.0)
    never = one | {"settle_s": float("nan"), "e_y_cm": 3.0}
    summary = summarise([one, never])
    assert summary["e_y_cm"] == 2.0
    assert summary["worst_e_y_cm"] == 3.0
    assert summary["lost"] == 2.0
    assert summary["unsettled"] == 1.0
    assert summary["settle_s"] == 1.0
    assert markdown("x", [row("m", "c", 2, summary)]).count("\n") == 5
