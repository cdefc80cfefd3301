"""The real-time controller: its motion in closed form, its constraints, its statuses, and the docking."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import daqp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.config import default_config_path, load_config
from common.errors import ConfigError
from common.geometry import Array, Pose2, features_at, move_relative, pose_from_paper_start
from follower.controller import realtime
from follower.controller.interface import Goal, MotionState, PlanStatus, SpeedCaps
from follower.controller.knots import KnotBasis
from follower.controller.realtime import RealtimeController
from follower.controller.rollout import roll_out
from follower.controller.wheel_lag import wheel_response
from follower.model.motion import NO_DISTURBANCE, MotionDisturbance

PERIOD_S = 0.05


CONFIG = load_config(default_config_path())
POINTS, CAMERA = CONFIG.leds.points, CONFIG.camera.mount
GOAL = Goal(features_at(POINTS, CONFIG.docking.goal(1), CAMERA))
LIMITS, REALTIME = CONFIG.limits, CONFIG.controller.realtime
CAPS = SpeedCaps(v_min_m_s=LIMITS.v_min_m_s, v_max_m_s=LIMITS.v_max_m_s, w_max_rad_s=LIMITS.w_max_rad_s)
PAPER_STARTS = [(6, 1.5, 0), (8, 1, -30), (7, -0.5, -45), (4, -1, 45), (6.2, 1.6, -45)]

poses = st.builds(Pose2, st.floats(1.6, 8.0), st.floats(-0.8, 0.8), st.floats(-0.3, 0.3))
disturbances = st.builds(
    MotionDisturbance, st.floats(-0.3, 0.1), st.floats(-0.4, 0.1), st.floats(-0.1, 0.1), st.floats(-0.05, 0.05)
)


def make() -> RealtimeController:
    return realtime.make(CONFIG)


def features(pose: Pose2) -> Array:
    return features_at(POINTS, pose, CAMERA)


def acting(disturbance: MotionDisturbance, v_m_s: float) -> MotionDisturbance:
    """What is left of a disturbance at a speed, by a law that the controller does not know."""
    share = min(1.0, abs(v_m_s) / 0.03)
    return replace(
        disturbance, yaw_rad_s=share * disturbance.yaw_rad_s, sideways_m_s=share * disturbance.sideways_m_s
    )


def inputs(seed: int, steps: int = 12) -> tuple[Array, Array]:
    random = np.random.default_rng(seed)
    return random.uniform(0.06, 0.5, steps), random.uniform(-0.6, 0.6, steps)


@given(poses, st.integers(0, 1000))
def test_undisturbed_rollout_is_the_exact_motion(pose: Pose2, seed: int) -> None:
    v, w = inputs(seed)
    rolled, moved = roll_out(pose, v, w, PERIOD_S, NO_DISTURBANCE), pose
    for k in range(v.size):
        moved = move_relative(moved, v[k], w[k], PERIOD_S)
        np.testing.assert_allclose(rolled.pose(k + 1).as_array(), moved.as_array(), atol=2e-5)
    np.testing.assert_allclose(rolled.poses()[-1], rolled.pose(v.size).as_array(), atol=1e-12)


@given(poses, disturbances, st.integers(0, 1000), st.integers(1, 12))
def test_sensitivities_are_the_derivatives(pose: Pose2, disturbance: MotionDisturbance, seed: int, k: int) -> None:
    v, w = inputs(seed)
    by_v, by_w = roll_out(pose, v, w, PERIOD_S, disturbance).sensitivity(k)
    step = 1e-6
    for j in range(k):
        axis = step * np.eye(v.size)[j]
        for slope, (dv, dw) in ((by_v[:, j], (axis, 0.0)), (by_w[:, j], (0.0, axis))):
            ahead = roll_out(pose, v + dv, w + dw, PERIOD_S, disturbance).pose(k).as_array()
            behind = roll_out(pose, v - dv, w - dw, PERIOD_S, disturbance).pose(k).as_array()
            np.testing.assert_allclose(slope, (ahead - behind) / (2 * step), atol=1e-7)


def test_wheel_response_is_a_first_order_lag() -> None:
    commands, speed, fine = np.array([0.3, 0.3, -0.1, 0.2]), 0.1, 2000
    response, free = wheel_response(4, PERIOD_S, 0.12)
    means = []
    for command in commands:
        trace = command + (speed - command) * np.exp(-np.linspace(0, PERIOD_S, fine) / 0.12)
        means.append(np.trapezoid(trace, dx=1 / (fine - 1)))
        speed = trace[-1]
    np.testing.assert_allclose(response @ commands + free * 0.1, means, atol=1e-6)
    no_lag, nothing = wheel_response(3, PERIOD_S, 0.0)
    np.testing.assert_array_equal(no_lag, np.eye(3))
    np.testing.assert_array_equal(nothing, np.zeros(3))


def test_knots_interpolate_and_shift_by_one_step() -> None:
    basis = KnotBasis((0, 1, 3, 7))
    values = np.array([0.0, 1.0, 3.0, 7.0])
    np.testing.assert_allclose(basis.basis @ values, np.arange(8.0))
    np.testing.assert_allclose(basis.shift @ values, [1.0, 2.0, 4.0, 7.0])
    np.testing.assert_allclose(basis.differences() @ values, [0.0] + [1.0] * 7)


@settings(max_examples=30, deadline=None)
@given(poses, disturbances, st.floats(-0.1, 0.33), st.floats(-0.6, 0.6), st.floats(0.02, 0.5), st.floats(0.1, 0.6))
def test_every_plan_keeps_speed_and_rate_limits(
    pose: Pose2, disturbance: MotionDisturbance, v: float, w: float, v_cap: float, w_cap: float
) -> None:
    controller = make()
    caps = SpeedCaps(v_min_m_s=-0.1, v_max_m_s=v_cap, w_max_rad_s=w_cap)
    for _ in range(3):
        plan = controller.solve(MotionState(pose, disturbance), GOAL, (v, w), caps)
        assert plan.usable, plan.status
        slack, (dv, dw) = 1e-6, REALTIME.rate_limit
        assert np.abs(np.diff(plan.v_m_s, prepend=v)).max() <= dv + slack
        assert np.abs(np.diff(plan.w_rad_s, prepend=w)).max() <= dw + slack
        knots = np.array(REALTIME.knots)
        braking_v = np.maximum(min(v_cap, REALTIME.cruise_m_s), v - dv * (knots + 1))
        braking_w = np.maximum(w_cap, abs(w) - dw * (knots + 1))
        steps = np.arange(plan.v_m_s.size)
        assert np.all(plan.v_m_s <= np.interp(steps, knots, braking_v) + slack)
        assert np.all(np.abs(plan.w_rad_s) <= np.interp(steps, knots, braking_w) + slack)
        assert plan.v_m_s.min() >= -0.1 - slack
        v, w = plan.first
        pose = move_relative(pose, v, w, PERIOD_S)


def test_a_start_out_of_view_is_solved_and_turned_into_view() -> None:
    pose = pose_from_paper_start(3.0, 0.0, np.radians(-64.0)).inverse()
    assert CONFIG.camera.pinhole.to_pixels(features(pose))[:, 0].min() < 0
    plan = make().solve(MotionState(pose), GOAL, (0.0, 0.0), CAPS)
    assert plan.usable
    pixels = CONFIG.camera.pinhole.to_pixels(features(Pose2(*plan.states[-1])))
    assert pixels[:, 0].min() > 0


@pytest.mark.parametrize("start", PAPER_STARTS)
@pytest.mark.parametrize("disturbance", [NO_DISTURBANCE, MotionDisturbance(-0.1, -0.2, 0.04, 0.02)])
def test_docks_from_the_papers_starts(start: tuple[float, float, float], disturbance: MotionDisturbance) -> None:
    controller = make()
    pose = pose_from_paper_start(start[0], start[1], np.radians(start[2])).inverse()
    applied = wheels = (0.0, 0.0)
    response, free = wheel_response(1, PERIOD_S, REALTIME.wheel_lag_ms * 1e-3)
    for _ in range(600):
        acting_now = acting(disturbance, wheels[0])
        plan = controller.solve(MotionState(pose, acting_now, wheels), GOAL, applied, CAPS)
        assert plan.usable, plan.status
        applied = plan.first
        driven = response[0, 0] * np.array(applied) + free[0] * np.array(wheels)
        pose = roll_out(pose, driven[:1], driven[1:], PERIOD_S, acting(disturbance, driven[0])).pose(1)
        keep = np.exp(-PERIOD_S / (REALTIME.wheel_lag_ms * 1e-3))
        wheels = tuple(keep * np.array(wheels) + (1 - keep) * np.array(applied))
        pixels = CONFIG.camera.pinhole.to_pixels(features(pose))
        assert np.all((pixels >= 0) & (pixels <= [1279, 1023]))
    assert abs(pose.x_m - 1.5) < 0.01
    undisturbed = disturbance == NO_DISTURBANCE
    assert abs(pose.inverse().y_m) < (0.001 if undisturbed else 0.010)  # sideways drift goes on to the end
    assert abs(pose.theta_rad) < np.radians(0.3 if undisturbed else 1.0)


@pytest.mark.parametrize(
    ("flag", "answer", "status"),
    [
        (1, 99.0, PlanStatus.NUMERICAL_FAILURE),
        (1, float("nan"), PlanStatus.NUMERICAL_FAILURE),
        (-1, 0.0, PlanStatus.INFEASIBLE),
        (-4, 0.0, PlanStatus.ITERATION_LIMIT),
        (-3, 0.0, PlanStatus.NUMERICAL_FAILURE),
    ],
)
def test_solver_that_fails_or_lies_is_caught(
    monkeypatch: pytest.MonkeyPatch, flag: int, answer: float, status: PlanStatus
) -> None:
    def lying(hessian: Array, *_: Any, **__: Any) -> tuple[Array, float, int, dict[str, Any]]:
        return np.full(len(hessian), answer), 0.0, flag, {"iterations": 1, "lam": np.zeros(3 * len(hessian))}

    monkeypatch.setattr(daqp, "solve", lying)
    plan = make().solve(MotionState(Pose2(3.0, 0.0, 0.0)), GOAL, (0.0, 0.0), CAPS)
    assert plan.status is status
    assert not plan.usable
    assert not plan.v_m_s.any()


@pytest.mark.parametrize("own_multipliers", [True, False])
def test_a_feasible_lie_is_caught(monkeypatch: pytest.MonkeyPatch, own_multipliers: bool) -> None:
    honest = daqp.solve

    def lying(hessian: Array, gradient: Array, matrix: Array, *rest: Any, **options: Any) -> tuple[Any, ...]:
        solution, value, flag, info = honest(hessian, gradient, matrix, *rest, **options)
        wrong = 0.9 * solution  # nearer to standstill: keeps every bound
        multipliers = np.array(info["lam"])
        if own_multipliers:  # that balance the wrong answer
            multipliers[:] = 0.0
            multipliers[: len(gradient)] = -(hessian @ wrong + gradient)
        return wrong, value, flag, info | {"lam": multipliers}

    arguments = (MotionState(Pose2(3.0, 0.1, 0.1)), GOAL, (0.0, 0.0), CAPS)
    assert make().solve(*arguments).usable
    monkeypatch.setattr(daqp, "solve", lying)
    assert make().solve(*arguments).status is PlanStatus.NUMERICAL_FAILURE
    monkeypatch.setattr(realtime, "OPTIMALITY", np.inf)
    assert make().solve(*arguments).usable  # so it is the optimality alone that tells


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), 1e6])
def test_impossible_commands_and_caps_are_a_status(bad: float) -> None:
    pose, good = Pose2(3.0, 0.0, 0.0), (0.0, 0.0)
    for applied, caps in (
        ((bad, 0.0), CAPS),
        (good, SpeedCaps(v_min_m_s=-0.1, v_max_m_s=float("nan"), w_max_rad_s=0.6)),
        (good, SpeedCaps(v_min_m_s=0.3, v_max_m_s=0.2, w_max_rad_s=0.6)),
        (good, SpeedCaps(v_min_m_s=-0.1, v_max_m_s=0.3, w_max_rad_s=-0.1)),
    ):
        assert make().solve(MotionState(pose), GOAL, applied, caps).status is PlanStatus.INVALID_INPUT
    unknown = make().solve(MotionState(pose, wheels=(float("nan"), 0.0)), GOAL, good, CAPS)
    assert unknown.status is PlanStatus.INVALID_INPUT


def test_invalid_input_is_a_status() -> None:
    nowhere = Pose2(float("nan"), 0.0, 0.0)
    plan = make().solve(MotionState(nowhere), GOAL, (0.0, 0.0), CAPS)
    assert plan.status is PlanStatus.INVALID_INPUT
    missing = GOAL.features.copy()
    missing[0] = np.nan
    assert make().solve(MotionState(Pose2(3.0, 0.0, 0.0)), Goal(missing), (0.0, 0.0), CAPS).status is plan.status


def test_solving_is_repeatable_to_the_bit() -> None:
    plans = []
    for _ in range(2):
        controller = make()
        controller.warm_up()
        plans.append(controller.solve(MotionState(Pose2(4.0, 0.3, 0.1)), GOAL, (0.1, 0.0), CAPS))
    np.testing.assert_array_equal(plans[0].v_m_s, plans[1].v_m_s)
    np.testing.assert_array_equal(plans[0].states, plans[1].states)


def test_knots_must_span_the_horizon() -> None:
    with pytest.raises(ConfigError, match="knots must rise from 0"):
        load_config(default_config_path(), ["controller.realtime.knots=[0, 3, 2, 39]"])
