"""Baselines: each does what its source says."""

from __future__ import annotations

import numpy as np
import pytest

from common.config import default_config_path, load_config
from common.geometry import Pose2, features_at, move_relative
from experiments.feature_level.baselines.gains import tuned_gains
from experiments.feature_level.baselines.graceful import GracefulGains, graceful
from experiments.feature_level.baselines.ibvs import ibvs
from experiments.feature_level.baselines.ke import KeController, KeWeights, goal_in_follower
from experiments.feature_level.pilots import PilotFactory
from experiments.feature_level.scenes import DISTURBANCES, PAPER_STARTS, method_config, paper_start
from experiments.feature_level.trial import fly, goal_task

CONFIG = load_config(default_config_path())
POINTS, CAMERA = CONFIG.leds.points, CONFIG.camera.mount
HEIGHTS = CAMERA[2] - POINTS[:, 2]
GOAL = CONFIG.docking.goal(1)
DESIRED = features_at(POINTS, GOAL, CAMERA)
DT = 0.05


def test_ibvs_brings_the_features_home_from_straight_behind() -> None:
    pose = Pose2(4.0, 0.0, 0.0)
    for _ in range(600):
        pose = move_relative(pose, *ibvs(features_at(POINTS, pose, CAMERA), DESIRED, HEIGHTS, CAMERA, 0.5), DT)
    np.testing.assert_allclose(features_at(POINTS, pose, CAMERA), DESIRED, atol=1e-3)


def test_ibvs_keeps_a_lateral_error_that_its_features_hardly_show() -> None:
    pose = Pose2(5.0, 1.2, 0.2)
    for _ in range(600):
        pose = move_relative(pose, *ibvs(features_at(POINTS, pose, CAMERA), DESIRED, HEIGHTS, CAMERA, 0.5), DT)
    assert abs(pose.inverse().y_m) > 0.10


def test_ibvs_stands_with_one_feature() -> None:
    seen = np.full_like(DESIRED, np.nan)
    seen[0] = DESIRED[0]
    assert ibvs(seen, DESIRED, HEIGHTS, CAMERA, 0.5) == (0.0, 0.0)


def test_goal_from_one_point_and_heading() -> None:
    pose = Pose2(4.0, 0.5, 0.2)
    goal_f = pose.compose(GOAL.inverse())
    feature = features_at(POINTS, pose, CAMERA)[2]
    to_point = GOAL.as_array()[:2] + POINTS[2, :2]
    found = goal_in_follower(feature, pose.theta_rad, float(HEIGHTS[2]), to_point, CAMERA)
    np.testing.assert_allclose(found, [goal_f.theta_rad, goal_f.x_m, goal_f.y_m], atol=1e-12)


@pytest.mark.parametrize("start", [Pose2(3.0, 0.4, 0.1), Pose2(2.0, -0.3, -0.2)])
def test_ke_and_graceful_reach_the_goal_without_noise(start: Pose2) -> None:
    ke, gains = (
        KeController(CONFIG.limits, KeWeights(**tuned_gains("ke"))),
        GracefulGains(**tuned_gains("pose_based")),
    )
    for method in ("ke", "graceful"):
        goal, v, w = start, 0.0, 0.0
        for _ in range(600):
            state = np.array([goal.theta_rad, goal.x_m, goal.y_m])
            before = v, w
            v, w = ke.solve(state, before) if method == "ke" else graceful(goal, 0.6, gains)
            if method == "ke":
                assert abs(v - before[0]) <= CONFIG.limits.controller_dv_m_s + 1e-6
                assert abs(w - before[1]) <= CONFIG.limits.controller_dw_rad_s + 1e-6
            goal = move_relative(goal, v, w, DT)
        assert np.hypot(goal.x_m, goal.y_m) < 0.03, method
        assert abs(goal.theta_rad) < np.radians(1.0), method


def test_pose_based_docking_arrives_with_its_heading_under_noise() -> None:
    task = goal_task(method_config(CONFIG, "pose_based"))
    pilot = PilotFactory("pose_based", task).make()
    metrics = fly(task, pilot, paper_start(PAPER_STARTS[3]), [1, 0], DISTURBANCES["none"]).metrics
    assert metrics["e_theta_deg"] < 2.5
    assert metrics["e_y_cm"] < 1.0
    assert metrics["over_bound"] == metrics["lost"] == 0.0


def test_ke_stands_where_its_numbers_are_none() -> None:
    ke = KeController(CONFIG.limits, KeWeights(**tuned_gains("ke")))
    assert ke.solve(np.array([0.0, np.nan, 1.0]), (0.1, 0.0)) == (0.0, 0.0)
    assert ke.solve(np.array([0.0, 1e200, 1.0]), (0.1, 0.0)) == (0.0, 0.0)
