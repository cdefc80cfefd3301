"""``davpc bench control``: the same closed-loop problems through every solver, in one process."""

from __future__ import annotations

import math
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from common.config import Config
from experiments.bench.plain_ipopt import PlainIpopt
from experiments.feature_level.pilots import DavpcPilot
from experiments.feature_level.scenes import (
    DISTURBANCES,
    FRAME_RATE_HZ,
    FRAMES_PER_COMMAND,
    PAPER_STARTS,
    method_config,
    paper_start,
)
from experiments.feature_level.sweep_settings import with_horizon, with_points
from experiments.feature_level.task import Task
from experiments.feature_level.trial import fly, goal_task
from experiments.shared.results import row, write_results
from follower.controller import realtime
from follower.controller.interface import (
    FeatureController,
    FeatureState,
    Goal,
    MotionState,
    Plan,
    PoseController,
    SpeedCaps,
    Velocity,
)
from follower.paper import nmpc

SOLVERS = ("plain_ipopt", "paper_ipopt", "paper_fatrop", "davpc")
HORIZONS = (10, 20, 30, 40, 60)
POINTS = (4, 6, 8, 12)
SEGMENTS = 5  # of each run, evenly spaced, the last one up to the arrival
EPSILON_V_M_S, EPSILON_W_RAD_S = 0.01, 0.03  # a first input farther from the converged one is a silent failure
CONVERGED_STEPS = 100


@dataclass(frozen=True)
class Problem:
    """The arguments of one solve in closed loop, for either kind of controller.

    ``first`` begins without a warm start. ``timed`` is false where the run itself had one: there the solve only
    leads in.
    """

    first: bool
    motion: MotionState
    seen: FeatureState
    goal: Goal
    last_applied: Velocity
    caps: SpeedCaps
    timed: bool = True


class Solver(Protocol):
    """A controller under test, whatever it plans from."""

    def warm_up(self) -> None: ...

    def reset(self) -> None: ...

    def solve(self, problem: Problem) -> Plan: ...


class _ByPose:
    """The default controller."""

    def __init__(self, inner: PoseController) -> None:
        self._inner = inner
        self.warm_up, self.reset = inner.warm_up, inner.reset

    def solve(self, problem: Problem) -> Plan:
        return self._inner.solve(problem.motion, problem.goal, problem.last_applied, problem.caps)


class _ByFeatures:
    """The paper's controller."""

    def __init__(self, inner: FeatureController) -> None:
        self._inner = inner
        self.warm_up, self.reset = inner.warm_up, inner.reset

    def solve(self, problem: Problem) -> Plan:
        return self._inner.solve(problem.seen, problem.goal, problem.last_applied, problem.caps)


class _Plain:
    """The yardstick: each solve begins cold."""

    def __init__(self, inner: PlainIpopt) -> None:
        self._inner = inner

    def warm_up(self) -> None:
        """Nothing."""

    def reset(self) -> None:
        """Nothing."""

    def solve(self, problem: Problem) -> Plan:
        return self._inner.solve(problem.seen, problem.goal, problem.caps)


@dataclass(frozen=True)
class Timing:
    """Milliseconds of one solver over the problems, and how many it did not solve."""

    median_ms: float
    p99_ms: float
    max_ms: float
    failures: int
    silent_failures: int


class _Recorder:
    """Passes problems on to a controller and keeps them, with the features that the pose implies."""

    def __init__(self, inner: PoseController, task: Task) -> None:
        self._inner, self._task = inner, task
        self.problems: list[Problem] = []
        self._first = True

    def warm_up(self) -> None:
        self._inner.warm_up()

    def reset(self) -> None:
        self._inner.reset()
        self._first = True

    def solve(self, state: MotionState, goal: Goal, last_applied: Velocity, caps: SpeedCaps) -> Plan:
        pose = state.leader_in_follower
        seen = FeatureState(self._task.seen_from(pose), pose.theta_rad)
        self.problems.append(Problem(self._first, state, seen, goal, last_applied, caps))
        self._first = False
        return self._inner.solve(state, goal, last_applied, caps)


def record_problems(config: Config, count: int, seed: int) -> list[Problem]:
    """Problems of the default method in closed loop with noise, from the paper's starts to the arrival.

    ``count`` to be timed: from each run the same number, in segments of consecutive ones spread over the whole of
    it, and a lead-in before each segment that does not begin the run.
    """
    task = goal_task(method_config(config, "davpc"))
    recorder = _Recorder(realtime.make(task.config), task)
    recorder.warm_up()
    each = -(-count // len(PAPER_STARTS))
    kept: list[Problem] = []
    for i, start in enumerate(PAPER_STARTS):
        recorder.problems.clear()
        flown = fly(task, DavpcPilot(task, recorder), paper_start(start), [seed, i], DISTURBANCES["none"])
        settled_s = flown.metrics["settle_s"]
        last = -1 if math.isnan(settled_s) else round(settled_s * FRAME_RATE_HZ / FRAMES_PER_COMMAND)
        kept.extend(segments(recorder.problems[: last + 1 or None], min(each, count - i * each)))
    return kept


def segments(run: list[Problem], count: int) -> list[Problem]:
    """``count`` problems of one run to be timed, spread over it, with their lead-ins."""
    kept: list[Problem] = []
    parts = max(1, min(SEGMENTS, count))
    sizes = [len(part) for part in np.array_split(np.arange(min(count, len(run))), parts)]
    for k, size in enumerate(sizes):
        begin = round((len(run) - size) * k / (parts - 1)) if parts > 1 else 0
        if begin > 0:
            kept.append(replace(run[begin - 1], first=True, timed=False))
        kept.extend(run[begin : begin + size])
    return kept


def time_solver(config: Config, solver: str, problems: list[Problem]) -> Timing:
    """Solve all in order, warm-started as in closed loop."""
    controller = _make(config, solver)
    controller.warm_up()
    durations, failures, silent = [], 0, 0
    for problem in problems:
        if problem.first:
            controller.reset()
        begin = time.perf_counter()
        plan = controller.solve(problem)
        if not problem.timed:
            continue
        durations.append(1e3 * (time.perf_counter() - begin))
        failures += not plan.usable
        silent += plan.usable and not _kept(config, problem, plan, check_first=solver != "plain_ipopt")
    taken = np.array(durations)
    return Timing(float(np.median(taken)), float(np.percentile(taken, 99)), float(taken.max()), failures, silent)


def worst_difference(config: Config, solver: str, problems: list[Problem], every: int) -> tuple[float, float, int]:
    """Worst |Δv|, |Δω| of the first input to the converged solution of the same formulation; how many miss it.

    Args:
        config: the robots.
        solver: one of ``SOLVERS``; it runs through all problems, warm-started.
        problems: in order.
        every: so many are solved again to convergence.
    """
    quick = _make(config, solver)
    own = solver == "davpc"
    converged = _ByPose(realtime.make(config, CONVERGED_STEPS)) if own else _make(config, "paper_ipopt")
    worst, beyond = np.zeros(2), 0
    for i, problem in enumerate(problems):
        if problem.first:
            quick.reset()
        plan = quick.solve(problem)
        if i % every:
            continue
        converged.reset()
        reference = converged.solve(problem)
        if plan.usable and reference.usable:
            difference = np.abs(np.subtract(plan.first, reference.first))
            worst = np.maximum(worst, difference)
            beyond += bool(np.any(difference > (EPSILON_V_M_S, EPSILON_W_RAD_S)))
    return float(worst[0]), float(worst[1]), beyond


def run(out: Path, seed: int, jobs: int, config: Config, problems: int = 600) -> dict[str, Any]:  # noqa: ARG001
    """Time every solver on the same problems; write ``results.json`` and ``table.md``.

    Args:
        out: folder for the results.
        seed: random seed.
        jobs: not used: timings need the machine alone.
        config: the robots.
        problems: how many are timed.
    """
    setting = method_config(config, "paper")
    recorded = record_problems(config, problems, seed)
    rows, plain = [], 0.0
    for solver in SOLVERS:
        timing = time_solver(setting, solver, recorded)
        plain = plain or timing.median_ms
        dv, dw, beyond = worst_difference(setting, solver, recorded, every=10)
        metrics = {**asdict(timing), "times_plain": plain / timing.median_ms, "worst_dv": dv, "worst_dw": dw}
        if solver != "plain_ipopt":  # which leaves u_0 free: another problem
            metrics["silent_failures"] += beyond
        rows.append(row(solver, "closed_loop", len(recorded), metrics))
    return write_results(
        out,
        "bench_control",
        seed,
        {"problems": problems, "epsilon": [EPSILON_V_M_S, EPSILON_W_RAD_S]},
        rows + _scaling(config, seed),
        [],
        config,
    )


def _scaling(config: Config, seed: int) -> list[dict[str, Any]]:
    """Median against N_p and against the number of points."""
    rows = []
    for case, setting in [
        *((f"horizon_{n}", with_horizon(config, n)) for n in HORIZONS),
        *((f"points_{n}", with_points(config, n)) for n in POINTS),
    ]:
        recorded = record_problems(setting, 40, seed)
        for solver in ("paper_fatrop", "davpc"):
            timing = time_solver(method_config(setting, "paper"), solver, recorded)
            rows.append(row(solver, case, len(recorded), {"median_ms": timing.median_ms, "p99_ms": timing.p99_ms}))
    return rows


def _make(config: Config, solver: str) -> Solver:
    if solver == "plain_ipopt":
        return _Plain(PlainIpopt(config))
    if solver == "davpc":
        return _ByPose(realtime.make(config))
    return _ByFeatures(nmpc.make(config, "ipopt" if solver == "paper_ipopt" else "fatrop"))


def _kept(config: Config, problem: Problem, plan: Plan, check_first: bool) -> bool:
    """Whether a plan that calls itself solved keeps velocity bounds and rate limit."""
    limits, slack = config.limits, 1e-5
    v, w = plan.v_m_s, plan.w_rad_s
    rate_v, rate_w = np.abs(np.diff(v)), np.abs(np.diff(w))
    if check_first:
        rate_v = np.append(rate_v, abs(v[0] - problem.last_applied[0]))
        rate_w = np.append(rate_w, abs(w[0] - problem.last_applied[1]))
    return bool(
        np.isfinite(v).all()
        and v.min() >= limits.v_min_m_s - slack
        and v.max() <= limits.v_max_m_s + slack
        and np.abs(w).max() <= limits.w_max_rad_s + slack
        and rate_v.max() <= limits.controller_dv_m_s + slack
        and rate_w.max() <= limits.controller_dw_rad_s + slack
    )
