"""The paper's observer: what it converges to, its error bound, its freezing; and compensation."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.config import CompensationConfig, default_config_path, load_config
from common.geometry import Array, Pose2, extended_interaction_matrix, features_at
from follower.controller.interface import SpeedCaps
from follower.controller.limits import limited
from follower.paper.compensation import compensation
from follower.paper.eso import ExtendedStateObserver
from follower.paper.eso_bound import error_bound
from follower.paper.model import extended_state

CONFIG = load_config(default_config_path())
POINTS, CAMERA = CONFIG.leds.points, CONFIG.camera.mount
HEIGHTS = CAMERA[2] - POINTS[:, 2]
POSE = Pose2(2.5, 0.1, 0.05)
STATE = extended_state(features_at(POINTS, POSE, CAMERA), POSE.theta_rad)
DT = 1 / 240


def make(bandwidth: float = 1.0, bound: float = 5.0) -> ExtendedStateObserver:
    config = CompensationConfig(
        bandwidth_rad_s=bandwidth, observer_input="command", feature_bound=bound, theta_bound_rad_s=bound
    )
    return ExtendedStateObserver(HEIGHTS, CAMERA, config)


def jacobian(state: Array) -> Array:
    return extended_interaction_matrix(state[:-1].reshape(-1, 2), HEIGHTS, CAMERA)


def test_constant_disturbance_is_found() -> None:
    observer, state, true = make(4.0), STATE.copy(), np.linspace(-0.01, 0.01, 9)
    observer.reset(state)
    for _ in range(round(4 / DT)):
        state = state + DT * true
        observer.update(state, 0.0, 0.0, DT)
    np.testing.assert_allclose(observer.disturbance, true, atol=1e-4)


def test_state_is_neither_ahead_of_the_measurement_nor_behind() -> None:
    observer, state, period = make(2.0), STATE.copy(), 1 / 60
    observer.reset(state)
    for _ in range(240):
        state = state + period * (jacobian(state) @ [0.3, 0.05])
        observer.update(state, 0.3, 0.05, period)
    a_frame = np.abs(period * (jacobian(state) @ [0.3, 0.05])).max()
    assert np.abs(observer.state - state).max() < 0.15 * a_frame


@settings(max_examples=20, deadline=None)
@given(st.floats(0.5, 6.0), st.integers(0, 10_000))
def test_observer_keeps_the_bound_of_its_gains(bandwidth: float, seed: int) -> None:
    """From zero initial error, for random disturbances whose rate is bounded by γ."""
    random, gamma = np.random.default_rng(seed), 0.05
    bound = error_bound(2 * bandwidth, bandwidth**2).at(0.0, gamma)
    observer, state, disturbance = make(bandwidth), STATE.copy(), np.zeros(9)
    observer.reset(state)
    rate, worst = np.zeros(9), np.zeros(2)
    for step in range(round(6 / DT)):
        if step % 60 == 0:
            rate = gamma * random.choice([-1.0, 1.0], 9)
        disturbance = disturbance + DT * rate
        state = state + DT * (jacobian(state) @ [0.02, 0.01] + disturbance)
        observer.update(state, 0.02, 0.01, DT)
        errors = np.abs(state - observer.state).max(), np.abs(disturbance - observer.disturbance).max()
        worst = np.maximum(worst, errors)
    assert np.all(worst > 0.0)
    assert np.all(worst <= bound * (1 + 0.02) + 1e-4)  # the step is discrete


def test_invalid_measurement_freezes_the_disturbance_and_the_state_moves_on() -> None:
    observer = make()
    observer.reset(STATE)
    observer.update(STATE + 0.01, 0.1, 0.0, DT)
    before, moved = observer.disturbance.copy(), observer.state.copy()
    missing = STATE.copy()
    missing[0:2] = np.nan
    observer.update(missing, 0.1, 0.05, DT)
    np.testing.assert_array_equal(observer.disturbance, before)
    expected = moved + DT * (jacobian(moved) @ [0.1, 0.05] + before)
    np.testing.assert_allclose(observer.state, expected)


def test_estimate_cannot_wind_up() -> None:
    observer = make(bound=0.2)
    observer.reset(STATE)
    for _ in range(2000):
        observer.update(STATE + 1.0, 0.0, 0.0, DT)
    assert np.abs(observer.disturbance).max() <= 0.2


@given(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))
def test_compensation_cancels_what_an_input_could_have_caused(v: float, w: float) -> None:
    found = compensation(jacobian(STATE), jacobian(STATE) @ [v, w])
    np.testing.assert_allclose(found, [-v, -w], atol=1e-9)


@given(
    st.tuples(st.floats(-5, 5), st.floats(-5, 5)),
    st.tuples(st.floats(-0.1, 0.5), st.floats(-0.6, 0.6)),
    st.floats(0.0, 0.5),
)
def test_limited_command_keeps_cap_and_rate(
    wanted: tuple[float, float], last: tuple[float, float], cap: float
) -> None:
    v, w = limited(wanted, last, SpeedCaps(v_min_m_s=-0.1, v_max_m_s=cap, w_max_rad_s=0.6), CONFIG.limits)
    dv, dw = CONFIG.limits.controller_dv_m_s, CONFIG.limits.controller_dw_rad_s
    assert abs(v - last[0]) <= dv + 1e-12
    assert abs(w - last[1]) <= dw + 1e-12
    assert v <= max(cap, last[0] - dv) + 1e-12
    assert abs(w) <= 0.6 + 1e-12


def test_a_wanted_command_within_the_limits_is_left_alone() -> None:
    assert limited(
        (0.11, 0.02), (0.10, 0.0), SpeedCaps(v_min_m_s=-0.1, v_max_m_s=0.5, w_max_rad_s=0.6), CONFIG.limits
    ) == pytest.approx((0.11, 0.02))
