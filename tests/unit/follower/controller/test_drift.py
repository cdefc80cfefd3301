"""What the default controller expects of a drift, and where a drifting robot stands."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.config import default_config_path, load_config
from common.geometry import Pose2, features_at
from follower.controller import realtime
from follower.controller.drift import DriftStop, as_planned
from follower.controller.interface import Goal, MotionState, SpeedCaps
from follower.model.motion import FADING_BELOW_M_S, NO_DISTURBANCE, MotionDisturbance

CONFIG = load_config(default_config_path())
POINTS, CAMERA, LIMITS = CONFIG.leds.points, CONFIG.camera.mount, CONFIG.limits
DRIFTING = MotionDisturbance(yaw_rad_s=0.05, sideways_m_s=0.02)


def test_at_speed_a_drift_is_expected_as_it_is() -> None:
    assert as_planned(DRIFTING, 0.2) == DRIFTING


def test_a_robot_that_stands_expects_none() -> None:
    assert as_planned(DRIFTING, 0.0) == NO_DISTURBANCE


@given(st.floats(0.01, FADING_BELOW_M_S), st.floats(-0.01, 0.01))
def test_sideways_the_same_for_each_metre(speed: float, sideways: float) -> None:
    planned = as_planned(MotionDisturbance(sideways_m_s=sideways), speed)
    at_this_speed = planned.sideways_m_s * speed / FADING_BELOW_M_S  # as the roll-out fades it
    assert at_this_speed == pytest.approx(sideways, abs=1e-12)


@given(st.floats(-0.5, 0.5), st.floats(-0.15, 0.15))
def test_never_more_sideways_than_forwards(speed: float, sideways: float) -> None:
    assert abs(as_planned(MotionDisturbance(sideways_m_s=sideways), speed).sideways_m_s) <= FADING_BELOW_M_S


def test_standing_has_a_hysteresis() -> None:
    stop, tolerance = DriftStop(np.array([0.01, 0.02])), np.array([0.01, 0.02])
    assert not stop.update(0.6 * tolerance)
    assert stop.update(0.4 * tolerance)
    assert stop.update(-0.9 * tolerance)
    assert not stop.update(1.1 * tolerance)
    assert not stop.update(0.6 * tolerance)
    assert stop.update(0.4 * tolerance)
    stop.reset()
    assert not stop.update(0.6 * tolerance)


@pytest.mark.parametrize(("disturbance", "stands"), [(DRIFTING, True), (NO_DISTURBANCE, False)])
def test_a_drifting_robot_near_the_goal_brakes_and_stays(disturbance: MotionDisturbance, stands: bool) -> None:
    controller = realtime.make(CONFIG)
    caps = SpeedCaps(v_min_m_s=LIMITS.v_min_m_s, v_max_m_s=LIMITS.v_max_m_s, w_max_rad_s=LIMITS.w_max_rad_s)
    goal = Goal(features_at(POINTS, CONFIG.docking.goal(1), CAMERA))
    here, last = Pose2(1.508, 0.001, 0.001), (0.02, 0.01)
    first = controller.solve(MotionState(here, disturbance, last), goal, last, caps)
    assert first.usable
    assert abs(first.first[0] - last[0]) <= LIMITS.controller_dv_m_s
    second = controller.solve(MotionState(here, disturbance, first.first), goal, first.first, caps)
    assert (second.first == (0.0, 0.0)) == stands
