"""The paper's problem: its model, its constraints, its statuses, and the docking it leads to."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.config import Config, ConfigError, default_config_path, load_config
from common.geometry import (
    Array,
    Pose2,
    features_at,
    interaction_matrix,
    move_relative,
    pose_from_paper_start,
)
from follower.controller.interface import PlanStatus, PredictiveController, SpeedCaps, make_controller
from follower.controller.model import euler_step, extended_state, symbolic_euler_step

CONFIG = load_config(default_config_path(), ['controller.solver="fatrop"', "controller.effort_weight=[0.003, 0.003]"])
POINTS, CAMERA = CONFIG.leds.points, CONFIG.camera.mount
HEIGHTS = CAMERA[2] - POINTS[:, 2]
CAPS = SpeedCaps(CONFIG.limits.v_min_m_s, CONFIG.limits.v_max_m_s, CONFIG.limits.w_max_rad_s)
GOAL = features_at(POINTS, CONFIG.docking.goal(1), CAMERA)
OFFSET_CAMERA = np.array([0.25, 0.07, 1.20])
PAPER_STARTS = [(6, 1.5, 0), (8, 1, -30), (7, -0.5, -45), (4, -1, 45), (6.2, 1.6, -45)]

poses = st.builds(Pose2, st.floats(1.3, 8.0), st.floats(-1.0, 1.0), st.floats(-0.6, 0.6))


@pytest.fixture(scope="module")
def controller() -> PredictiveController:
    made = make_controller(CONFIG)
    made.warm_up()
    return made


def features(pose: Pose2) -> Array:
    return features_at(POINTS, pose, CAMERA)


@given(poses, st.floats(-0.1, 0.5), st.floats(-0.6, 0.6))
def test_interaction_matrix_is_the_derivative_of_the_projection(pose: Pose2, v: float, w: float) -> None:
    step = 1e-5
    ahead = features_at(POINTS, move_relative(pose, v, w, step), OFFSET_CAMERA)
    behind = features_at(POINTS, move_relative(pose, v, w, -step), OFFSET_CAMERA)
    here = features_at(POINTS, pose, OFFSET_CAMERA)
    rates = interaction_matrix(here, HEIGHTS, OFFSET_CAMERA) @ [v, w]
    np.testing.assert_allclose(rates, (ahead - behind) / (2 * step), atol=1e-7)


@given(poses, st.floats(-0.1, 0.5), st.floats(-0.6, 0.6))
def test_symbolic_and_numeric_model_agree(pose: Pose2, v: float, w: float) -> None:
    state, control = ca.SX.sym("x", 9), ca.SX.sym("u", 2)
    step = ca.Function("f", [state, control], [symbolic_euler_step(state, control, 0.05, HEIGHTS, OFFSET_CAMERA)])
    start = extended_state(features_at(POINTS, pose, OFFSET_CAMERA), pose.theta_rad)
    symbolic = np.asarray(step(start, [v, w])).ravel()
    np.testing.assert_allclose(symbolic, euler_step(start, v, w, 0.05, HEIGHTS, OFFSET_CAMERA), atol=1e-12)


def test_one_euler_step_errs_below_a_tenth_of_a_pixel() -> None:
    pose = Pose2(2.0, 0.1, 0.1)
    stepped = euler_step(extended_state(features(pose), pose.theta_rad), 0.3, 0.1, 0.05, HEIGHTS, CAMERA)
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
    controller: PredictiveController, pose: Pose2, v: float, w: float, v_cap: float
) -> None:
    controller.reset()
    plan = controller.solve(pose, features(pose), pose.theta_rad, GOAL, 0.0, (v, w), SpeedCaps(-0.1, v_cap, 0.6))
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


def test_plan_follows_its_own_model(controller: PredictiveController) -> None:
    pose = Pose2(4.0, 0.4, 0.1)
    plan = controller.solve(pose, features(pose), pose.theta_rad, GOAL, 0.0, (0.0, 0.0), CAPS)
    for k in range(plan.v_m_s.size):
        following = euler_step(plan.states[k], plan.v_m_s[k], plan.w_rad_s[k], 0.05, HEIGHTS, CAMERA)
        np.testing.assert_allclose(plan.states[k + 1], following, atol=1e-6)


def test_a_start_out_of_view_is_solved_and_turned_into_view(controller: PredictiveController) -> None:
    pose = pose_from_paper_start(3.0, 0.0, np.radians(-64.0)).inverse()
    start = features(pose)
    assert CONFIG.camera.pinhole.to_pixels(start)[:, 0].min() < -18  # beyond the bound by more than IPOPT forgives
    controller.reset()
    plan = controller.solve(pose, start, pose.theta_rad, GOAL, 0.0, (0.0, 0.0), CAPS)
    assert plan.usable
    pixels = CONFIG.camera.pinhole.to_pixels(plan.states[-1, :-1].reshape(-1, 2))
    assert pixels[:, 0].min() >= CONFIG.controller.visibility_margin_px - 0.5


def test_lies_and_noise_become_a_status(controller: PredictiveController) -> None:
    pose = Pose2(8.0, 0.0, 0.0)
    flipped = features(pose)
    flipped[0, 1] = 0.001
    plan = controller.solve(pose, flipped, 0.0, GOAL, 0.0, (0.0, 0.0), CAPS)
    assert plan.status is PlanStatus.FLIPPED_FEATURE
    assert not plan.usable
    missing = features(pose)
    missing[2] = np.nan
    assert controller.solve(pose, missing, 0.0, GOAL, 0.0, (0.0, 0.0), CAPS).status is PlanStatus.INVALID_INPUT


@pytest.mark.parametrize("start", PAPER_STARTS)
def test_docks_from_the_papers_starts(controller: PredictiveController, start: tuple[float, float, float]) -> None:
    relative = pose_from_paper_start(start[0], start[1], np.radians(start[2])).inverse()
    applied = (0.0, 0.0)
    controller.reset()
    for _ in range(560):
        plan = controller.solve(relative, features(relative), relative.theta_rad, GOAL, 0.0, applied, CAPS)
        assert plan.usable, plan.status
        applied = plan.first
        relative = move_relative(relative, *applied, 0.05)
        pixels = CONFIG.camera.pinhole.to_pixels(features(relative))
        assert np.all((pixels >= 0) & (pixels <= [1279, 1023]))
    assert abs(relative.x_m - 1.5) < 0.02
    assert abs(relative.y_m) < 0.01
    assert abs(relative.theta_rad) < np.radians(0.6)


def test_reference_and_default_solver_agree(controller: PredictiveController) -> None:
    reference = make_controller(_with(CONFIG, "ipopt"))
    for pose in (Pose2(5.0, 0.5, 0.2), Pose2(2.2, -0.1, -0.05), Pose2(1.52, 0.01, 0.01)):
        controller.reset()
        arguments = (pose, features(pose), pose.theta_rad, GOAL, 0.0, (0.1, 0.0), CAPS)
        mine, theirs = controller.solve(*arguments), reference.solve(*arguments)
        assert theirs.usable
        np.testing.assert_allclose(mine.first, theirs.first, atol=2e-3)


def test_unknown_solver_is_named() -> None:
    with pytest.raises(ConfigError, match=r"controller\.solver: 'magic'"):
        make_controller(_with(CONFIG, "magic"))


def _with(config: Config, solver: str) -> Config:
    return config.model_copy(update={"controller": config.controller.model_copy(update={"solver": solver})})
