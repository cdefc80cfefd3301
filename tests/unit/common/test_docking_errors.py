"""The error of a docked pose: its signs, and its independence of the goal's distance."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.config import load_config
from common.docking_errors import docked_error, paper_errors
from common.geometry import Pose2
from tests.rigs.canbus_rig import CONFIG_PATH

GOAL = Pose2(1.4, 0.0, 0.0)
POSES = st.builds(Pose2, st.floats(-9, 9), st.floats(-9, 9), st.floats(-3.1, 3.1))


def test_a_follower_too_far_behind_left_and_turned_left_has_positive_errors() -> None:
    error = docked_error(Pose2(-1.5, 0.02, 0.03), GOAL)
    assert (error.e_x_m, error.e_y_m, error.e_theta_rad) == pytest.approx((0.1, 0.02, 0.03))
    assert error.e_theta_deg == pytest.approx(math.degrees(0.03))


@given(POSES)
def test_there_is_no_error_at_the_goal(goal: Pose2) -> None:
    error = docked_error(goal.inverse(), goal)
    assert (error.e_x_m, error.e_y_m, error.e_theta_rad) == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)


@given(POSES)
def test_an_estimate_of_the_leader_is_inverted_first(leader_in_follower: Pose2) -> None:
    c, s = math.cos(leader_in_follower.theta_rad), math.sin(leader_in_follower.theta_rad)
    error = docked_error(leader_in_follower.inverse(), GOAL)
    behind_m = leader_in_follower.x_m * c + leader_in_follower.y_m * s
    assert error.e_x_m == pytest.approx(behind_m - GOAL.x_m)
    assert error.e_y_m == pytest.approx(leader_in_follower.x_m * s - leader_in_follower.y_m * c)


def test_the_heading_is_wrapped() -> None:
    assert docked_error(Pose2(-1.4, 0.0, 3.1), Pose2(1.4, 0.0, 0.1)).e_theta_rad == pytest.approx(3.2 - 2 * math.pi)


def test_the_papers_columns_are_magnitudes_and_have_no_pixels_behind_the_array() -> None:
    config = load_config(CONFIG_PATH)
    goal = config.docking.goal(1)
    at_goal = paper_errors(goal.inverse(), goal, config)
    assert at_goal == pytest.approx({"e_x_cm": 0.0, "e_y_cm": 0.0, "e_theta_deg": 0.0, "e_p_px": 0.0}, abs=1e-9)
    right_of_it = goal.inverse().compose(Pose2(0.0, -0.01, 0.0))
    off = paper_errors(right_of_it, goal, config)
    assert off["e_y_cm"] == pytest.approx(1.0)
    assert off["e_p_px"] > 3.0
    assert math.isnan(paper_errors(Pose2(5.0, 0.0, 0.0), goal, config)["e_p_px"])
