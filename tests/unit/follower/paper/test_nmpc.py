"""The paper's problem: its model, its constraints, its statuses, and the docking it leads to."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Literal

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.config import default_config_path, load_config
from common.geometry import (
    Array,
    Pose2,
    extended_interaction_matrix,
    features_at,
    move_relative,
    pose_from_paper_start,
)
from follower.controller.interface import FeatureState, Goal, PlanStatus, SpeedCaps
from follower.paper import nmpc as paper_nmpc
from follower.paper.model import extended_state, symbolic_euler_step
from follower.paper.nmpc import PaperNmpc
from follower.paper.solver_process import Solution, SolverLostError, SolveTooLongError

CONFIG = load_config(
    default_config_path(), ["controller.effort_weight=[0.003, 0.003]", "controller.solve_limit_ms=20000"]
)
POINTS, CAMERA = CONFIG.leds.points, CONFIG.camera.mount
HEIGHTS = CAMERA[2] - POINTS[:, 2]
CAPS = SpeedCaps(
    v_min_m_s=CONFIG.limits.v_min_m_s, v_max_m_s=CONFIG.limits.v_max_m_s, w_max_rad_s=CONFIG.limits.w_max_rad_s
)
GOAL = Goal(features_at(POINTS, CONFIG.docking.goal(1), CAMERA))
OFFSET_CAMERA = np.array([0.25, 0.07, 1.20])
PAPER_STARTS = [(6, 1.5, 0), (8, 1, -30), (7, -0.5, -45), (4, -1, 45), (6.2, 1.6, -45)]

poses = st.builds(Pose2, st.floats(1.3, 8.0), st.floats(-1.0, 1.0), st.floats(-0.6, 0.6))


@pytest.fixture(scope="module")
def controller() -> PaperNmpc:
    made = paper_nmpc.make(CONFIG, "fatrop")
    made.warm_up()
    return made


def features(pose: Pose2) -> Array:
    return features_at(POINTS, pose, CAMERA)


def state_at(pose: Pose2) -> FeatureState:
    return FeatureState(features(pose), pose.theta_rad)


def euler_step(state: Array, v: float, w: float, heights: Array = HEIGHTS, camera: Array = CAMERA) -> Array:
    """One forward-Euler step of 50 ms of the nominal model: eq. (27)."""
    jacobian = extended_interaction_matrix(state[:-1].reshape(-1, 2), heights, camera)
    advanced: Array = state + 0.05 * jacobian @ [v, w]
    return advanced


@given(poses, st.floats(-0.1, 0.5), st.floats(-0.6, 0.6))
def test_symbolic_and_numeric_model_agree(pose: Pose2, v: float, w: float) -> None:
    state, control = ca.SX.sym("x", 9), ca.SX.sym("u", 2)
    step = ca.Function("f", [state, control], [symbolic_euler_step(state, control, 0.05, HEIGHTS, OFFSET_CAMERA)])
    start = extended_state(features_at(POINTS, pose, OFFSET_CAMERA), pose.theta_rad)
    symbolic = np.asarray(step(start, [v, w])).ravel()
    np.testing.assert_allclose(symbolic, euler_step(start, v, w, camera=OFFSET_CAMERA), atol=1e-12)


def test_one_euler_step_errs_below_a_tenth_of_a_pixel() -> None:
    pose = Pose2(2.0, 0.1, 0.1)
    stepped = euler_step(extended_state(features(pose), pose.theta_rad), 0.3, 0.1)
    exact = features(move_relative(pose, 0.3, 0.1, 0.05)).reshape(-1)
    assert np.abs(stepped[:-1] - exact).max() * CONFIG.camera.lens.fx_px < 0.1


@settings(max_examples=15, deadline=None)
@given(
    st.builds(Pose2, st.floats(1.6, 8.0), st.floats(-0.8, 0.8), st.floats(-0.3, 0.3)),
    st.floats(-0.1, 0.5),
    st.floats(-0.6, 0.6),
    st.floats(0.02, 0.5),
)
def test_every_plan_keeps_speed_and_rate_limits(
    controller: PaperNmpc, pose: Pose2, v: float, w: float, v_cap: float
) -> None:
    controller.reset()
    plan = controller.solve(state_at(pose), GOAL, (v, w), SpeedCaps(v_min_m_s=-0.1, v_max_m_s=v_cap, w_max_rad_s=0.6))
    assert plan.usable, plan.status
    limits, slack = CONFIG.limits, 1e-6
    rates_v = np.diff(np.append(v, plan.v_m_s))
    rates_w = np.diff(np.append(w, plan.w_rad_s))
    assert np.abs(rates_v).max() <= limits.controller_dv_m_s + slack
    assert np.abs(rates_w).max() <= limits.controller_dw_rad_s + slack
    braking = np.maximum(v_cap, v - limits.controller_dv_m_s * np.arange(1, plan.v_m_s.size + 1))
    assert np.all(plan.v_m_s <= braking + slack)
    assert plan.v_m_s.min() >= -0.1 - slack
    assert np.abs(plan.w_rad_s).max() <= 0.6 + slack


def test_plan_follows_its_own_model(controller: PaperNmpc) -> None:
    pose = Pose2(4.0, 0.4, 0.1)
    plan = controller.solve(state_at(pose), GOAL, (0.0, 0.0), CAPS)
    for k in range(plan.v_m_s.size):
        following = euler_step(plan.states[k], plan.v_m_s[k], plan.w_rad_s[k])
        np.testing.assert_allclose(plan.states[k + 1], following, atol=1e-6)


def test_a_start_out_of_view_is_solved_and_turned_into_view(controller: PaperNmpc) -> None:
    pose = pose_from_paper_start(3.0, 0.0, np.radians(-64.0)).inverse()
    start = features(pose)
    assert CONFIG.camera.pinhole.to_pixels(start)[:, 0].min() < -18  # beyond the bound by more than IPOPT forgives
    controller.reset()
    plan = controller.solve(state_at(pose), GOAL, (0.0, 0.0), CAPS)
    assert plan.usable
    pixels = CONFIG.camera.pinhole.to_pixels(plan.states[-1, :-1].reshape(-1, 2))
    assert pixels[:, 0].min() >= CONFIG.controller.visibility_margin_px - 0.5


def test_lies_and_noise_become_a_status(controller: PaperNmpc) -> None:
    pose = Pose2(8.0, 0.0, 0.0)
    flipped = features(pose)
    flipped[0, 1] = 0.001
    plan = controller.solve(FeatureState(flipped, 0.0), GOAL, (0.0, 0.0), CAPS)
    assert plan.status is PlanStatus.FLIPPED_FEATURE
    assert not plan.usable
    missing = features(pose)
    missing[2] = np.nan
    assert controller.solve(FeatureState(missing, 0.0), GOAL, (0.0, 0.0), CAPS).status is PlanStatus.INVALID_INPUT


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), 1e6])
@pytest.mark.parametrize("place", [0, 1])
def test_a_command_no_robot_drove_is_a_status(controller: PaperNmpc, bad: float, place: int) -> None:
    pose, applied = Pose2(4.0, 0.0, 0.0), [0.0, 0.0]
    applied[place] = bad
    plan = controller.solve(state_at(pose), GOAL, (applied[0], applied[1]), CAPS)
    assert plan.status is PlanStatus.INVALID_INPUT


@pytest.mark.parametrize(
    "caps",
    [
        SpeedCaps(v_min_m_s=-0.1, v_max_m_s=float("nan"), w_max_rad_s=0.6),
        SpeedCaps(v_min_m_s=float("nan"), v_max_m_s=0.3, w_max_rad_s=0.6),
        SpeedCaps(v_min_m_s=-0.1, v_max_m_s=0.3, w_max_rad_s=float("nan")),
        SpeedCaps(v_min_m_s=0.3, v_max_m_s=0.2, w_max_rad_s=0.6),
        SpeedCaps(v_min_m_s=5.0, v_max_m_s=6.0, w_max_rad_s=0.6),
        SpeedCaps(v_min_m_s=-0.1, v_max_m_s=0.3, w_max_rad_s=-0.2),
    ],
)
def test_caps_that_leave_no_speed_are_a_status(controller: PaperNmpc, caps: SpeedCaps) -> None:
    pose = Pose2(4.0, 0.0, 0.0)
    plan = controller.solve(state_at(pose), GOAL, (0.0, 0.0), caps)
    assert plan.status is PlanStatus.INVALID_INPUT


def test_a_wrong_number_of_points_is_a_status(controller: PaperNmpc) -> None:
    pose = Pose2(4.0, 0.0, 0.0)
    for seen, wanted in (
        (features(pose), GOAL.features[:3]),
        (features(pose)[:3], GOAL.features),
        (features(pose).ravel(), GOAL.features),
    ):
        plan = controller.solve(FeatureState(seen, 0.0), Goal(wanted), (0.0, 0.0), CAPS)
        assert plan.status is PlanStatus.INVALID_INPUT


class _Solver:
    """Stands in for CasADi's: the true answer changed, a status of its own, or an exception."""

    def __init__(
        self, honest: Any, scale: float = 1.0, status: object = None, broken: type[Exception] | None = None
    ) -> None:
        self._honest, self._scale, self._status, self._broken = honest, scale, status, broken

    def __call__(self, **problem: Any) -> Solution:
        if self._broken is not None:
            raise self._broken
        answer: Solution = self._honest(**problem)
        if self._scale != 1.0:
            slower = _slower(answer.values["x"], problem["p"], self._scale)
            return replace(answer, values=answer.values | {"x": slower})
        if self._status is None:
            return answer
        return replace(answer, stats={"success": False, "return_status": self._status, "iter_count": 7})


def _slower(solution: Any, parameters: Array, scale: float) -> Array:
    """A solution with the inputs scaled and the states that follow from them: it keeps every constraint."""
    size, horizon = 9, CONFIG.controller.horizon
    x = np.array(solution).ravel()
    stages = x[: horizon * (size + 5)].reshape(horizon, size + 5)
    state, applied = parameters[:size], parameters[size : size + 2]
    for stage in stages:
        stage[:size], stage[size : size + 2] = state, applied
        stage[size + 2 : size + 4] *= scale
        applied = stage[size + 2 : size + 4].copy()
        state = euler_step(state, applied[0], applied[1])
    x[-3 - size : -1] = np.concatenate([state, applied])
    return x


@pytest.mark.parametrize("solver", ["fatrop", "ipopt"])
def test_a_feasible_lie_is_caught(monkeypatch: pytest.MonkeyPatch, solver: Literal["fatrop", "ipopt"]) -> None:
    made, pose = paper_nmpc.make(CONFIG, solver), Pose2(4.0, 0.4, 0.1)
    arguments = (state_at(pose), GOAL, (0.0, 0.0), CAPS)
    assert made.solve(*arguments).usable
    made.reset()
    monkeypatch.setattr(made, "_solver", _Solver(made._solver, scale=0.9))
    assert made.solve(*arguments).status is PlanStatus.NUMERICAL_FAILURE
    monkeypatch.setattr(paper_nmpc, "OPTIMALITY", np.inf)
    assert made.solve(*arguments).usable  # so it is the optimality alone that tells


@pytest.mark.parametrize(
    ("status", "expected"),
    [
        (1, PlanStatus.ITERATION_LIMIT),
        (3, PlanStatus.INFEASIBLE),
        (4, PlanStatus.NUMERICAL_FAILURE),
        ("Maximum_Iterations_Exceeded", PlanStatus.ITERATION_LIMIT),
        ("Infeasible_Problem_Detected", PlanStatus.INFEASIBLE),
    ],
)
def test_each_solvers_way_to_fail_is_a_status(
    monkeypatch: pytest.MonkeyPatch, controller: PaperNmpc, status: object, expected: PlanStatus
) -> None:
    monkeypatch.setattr(controller, "_solver", _Solver(controller._solver, status=status))
    pose = Pose2(4.0, 0.4, 0.1)
    plan = controller.solve(state_at(pose), GOAL, (0.0, 0.0), CAPS)
    assert (plan.status, plan.iterations) == (expected, 7)


@pytest.mark.parametrize(
    ("error", "expected"),
    [(SolverLostError, PlanStatus.NUMERICAL_FAILURE), (SolveTooLongError, PlanStatus.TIME_LIMIT)],
)
def test_a_solver_that_breaks_off_is_a_status(
    monkeypatch: pytest.MonkeyPatch, controller: PaperNmpc, error: type[Exception], expected: PlanStatus
) -> None:
    monkeypatch.setattr(controller, "_solver", _Solver(controller._solver, broken=error))
    pose = Pose2(4.0, 0.4, 0.1)
    plan = controller.solve(state_at(pose), GOAL, (0.0, 0.0), CAPS)
    assert plan.status is expected


@pytest.mark.parametrize("start", PAPER_STARTS)
def test_docks_from_the_papers_starts(controller: PaperNmpc, start: tuple[float, float, float]) -> None:
    relative = pose_from_paper_start(start[0], start[1], np.radians(start[2])).inverse()
    applied = (0.0, 0.0)
    controller.reset()
    for _ in range(560):
        plan = controller.solve(state_at(relative), GOAL, applied, CAPS)
        assert plan.usable, plan.status
        applied = plan.first
        relative = move_relative(relative, *applied, 0.05)
        pixels = CONFIG.camera.pinhole.to_pixels(features(relative))
        assert np.all((pixels >= 0) & (pixels <= [1279, 1023]))
    assert abs(relative.x_m - 1.5) < 0.02
    assert abs(relative.y_m) < 0.01
    assert abs(relative.theta_rad) < np.radians(0.6)


def test_reference_and_default_solver_agree(controller: PaperNmpc) -> None:
    reference = paper_nmpc.make(CONFIG, "ipopt")
    for pose in (Pose2(5.0, 0.5, 0.2), Pose2(2.2, -0.1, -0.05), Pose2(1.52, 0.01, 0.01)):
        controller.reset()
        arguments = (state_at(pose), GOAL, (0.1, 0.0), CAPS)
        mine, theirs = controller.solve(*arguments), reference.solve(*arguments)
        assert theirs.usable
        np.testing.assert_allclose(mine.first, theirs.first, atol=2e-3)
