"""The bench of the controllers counts what a solver leaves unsolved and what it gets wrong."""

from __future__ import annotations

from dataclasses import replace

import pytest

from common.config import default_config_path, load_config
from experiments.bench import control as bench_control
from experiments.feature_level.scenes import method_config
from follower.controller.interface import Plan

CONFIG = load_config(default_config_path())
SETTING = method_config(CONFIG, "paper")
pytestmark = pytest.mark.xdist_group("problems of the controllers' bench")


@pytest.fixture(scope="module")
def problems() -> list[bench_control.Problem]:
    """Eight problems to be timed, with their lead-ins."""
    return bench_control.record_problems(SETTING, 8, 1)


def test_bench_counts_what_a_solver_leaves_unsolved_and_what_it_gets_wrong(
    problems: list[bench_control.Problem],
) -> None:
    assert sum(problem.timed for problem in problems) == 8
    assert problems[-1].motion.leader_in_follower.x_m < 1.55  # to the arrival, not only the first metres
    timing = bench_control.time_solver(SETTING, "davpc", problems)
    assert timing.failures == timing.silent_failures == 0
    assert 0 < timing.median_ms <= timing.p99_ms <= timing.max_ms
    *_, beyond = bench_control.worst_difference(SETTING, "davpc", problems, every=1)
    assert beyond == 0


def test_bench_counts_a_first_input_far_from_the_converged_one(
    problems: list[bench_control.Problem], monkeypatch: pytest.MonkeyPatch
) -> None:
    true = bench_control._make

    class Slower:
        def __init__(self) -> None:
            self._inner = true(SETTING, "davpc")
            self.reset = self._inner.reset

        def solve(self, problem: bench_control.Problem) -> Plan:
            plan = self._inner.solve(problem)
            return replace(plan, v_m_s=plan.v_m_s - 0.02)

    monkeypatch.setattr(bench_control, "_make", lambda *_: Slower())
    *_, beyond = bench_control.worst_difference(SETTING, "davpc", problems, every=1)
    assert beyond == len(problems)
