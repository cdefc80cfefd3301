"""Experiments: the same results for a seed at any number of jobs, in the agreed format, near the limit."""

from __future__ import annotations

import io
import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from common.config import default_config_path, load_config
from experiments.bench import control as bench_control
from experiments.feature_level import disturbance, table1
from experiments.feature_level.cramer_rao import bound
from experiments.feature_level.pilots import PilotFactory
from experiments.feature_level.scenes import DISTURBANCES, DISTURBED_START, method_config, paper_start, random_pads
from experiments.feature_level.sweep_settings import with_horizon, with_points
from experiments.feature_level.trial import METRICS, fly, goal_task, summarise
from experiments.shared.campaign import run_all
from experiments.shared.results import markdown, row, write_results
from follower.controller.interface import Plan

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


def test_table1_tells_the_information_limit_along_the_default_method_alone(tmp_path: Path) -> None:
    results = table1.run(tmp_path, 2, 1, CONFIG, trials=1, methods=("davpc", "ibvs"), cases=("W",))
    rows = {entry["method"]: entry for entry in results["rows"]}
    assert list(rows) == ["davpc", "ibvs", "cramer_rao"]
    assert rows["cramer_rao"]["n"] == 1
    assert 0.05 < rows["cramer_rao"]["metrics"]["e_y_cm"] < 0.4


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
    assert sum(problem.timed for problem in problems) == 8
    assert problems[-1].motion.leader_in_follower.x_m < 1.55  # to the arrival, not only the first metres
    timing = bench_control.time_solver(setting, "davpc", problems)
    assert timing.failures == timing.silent_failures == 0
    assert 0 < timing.median_ms <= timing.p99_ms <= timing.max_ms
    *_, beyond = bench_control.worst_difference(setting, "davpc", problems, every=1)
    assert beyond == 0


def test_bench_counts_a_first_input_far_from_the_converged_one(monkeypatch: pytest.MonkeyPatch) -> None:
    setting = method_config(CONFIG, "paper")
    problems = bench_control.record_problems(setting, 4, 1)
    true = bench_control._make

    class Slower:
        def __init__(self) -> None:
            self._inner = true(setting, "davpc")
            self.reset = self._inner.reset

        def solve(self, problem: bench_control.Problem) -> Plan:
            plan = self._inner.solve(problem)
            return replace(plan, v_m_s=plan.v_m_s - 0.02)

    monkeypatch.setattr(bench_control, "_make", lambda *_: Slower())
    *_, beyond = bench_control.worst_difference(setting, "davpc", problems, every=1)
    assert beyond == len(problems)


def test_settings_change_what_they_say() -> None:
    assert with_horizon(CONFIG, 20).controller.realtime.knots[-1] == 19
    assert with_points(CONFIG, 6).leds.points.shape == (6, 3)
    assert random_pads(1) == random_pads(1) != random_pads(2)


def test_a_metric_that_is_no_number_is_null_and_costs_no_other_result(tmp_path: Path) -> None:
    rows = [row("m", "c", 1, {"e_y_cm": float("nan"), "m_v": 0.1}), row("m", "d", 1, {"e_y_cm": float("inf")})]
    results = write_results(tmp_path, "x", 1, {"list": [(float("nan"), 1.0)]}, rows, [], CONFIG)
    text = (tmp_path / "results.json").read_text()
    assert json.loads(text) == results
    assert "NaN" not in text
    assert "Infinity" not in text
    assert results["rows"][0]["metrics"] == {"e_y_cm": None, "m_v": 0.1}
    assert results["rows"][1]["metrics"] == {"e_y_cm": None}
    assert results["settings"]["list"] == [[None, 1.0]]
    assert "| m | c | 1 | – | 0.100 |" in (tmp_path / "table.md").read_text()


def test_results_tell_the_configuration_with_its_overrides(tmp_path: Path) -> None:
    config = load_config(default_config_path(), ["controller.terminal_weight=7.5"])
    results = write_results(tmp_path, "x", 1, {}, [], [], config)
    kept = results["settings"]["configuration"]
    assert kept["controller"]["terminal_weight"] == 7.5
    assert kept == json.loads(config.model_dump_json())


def test_workers_give_linear_algebra_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    names = ["OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"]
    assert run_all(os.getenv, names, 2, "threads") == ["1", "1"]
    assert [os.getenv(name) for name in names] == ["3", None]


def test_a_log_is_told_the_progress_and_the_time_left_at_every_tenth() -> None:
    log = io.StringIO()
    assert run_all(abs, list(range(-40, 0)), 1, "many", Console(file=log, width=120)) == list(range(40, 0, -1))
    told = [line for line in log.getvalue().splitlines() if " min left" in line]
    assert len(told) == 10
    assert told[0].startswith("many: 4 of 40 after 0.0 min")
    assert "40 of 40" in told[-1]


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
