"""The paper's method as the robot runs it: it docks from its observer's state; no number of it stops the process."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from common.config import load_config
from common.geometry import Pose2, features_at, move_relative, pose_from_paper_start
from common.timing import NS_PER_S
from follower.controller.interface import Goal, PlanStatus, Request, SpeedCaps
from follower.paper.method import make
from tests.rigs.supervisor_rig import docking_state

FRAMES_PER_COMMAND = 3
FRAME_S = 1 / 60
NOISE = 0.3 / 640.0
CAPS = SpeedCaps(v_min_m_s=-0.1, v_max_m_s=0.5, w_max_rad_s=0.6)


@pytest.mark.parametrize("initial_state", ["observer", "measured"])
def test_docks_from_noisy_features(config_path: Path, initial_state: str) -> None:
    overrides = [
        "controller.method='paper_fatrop'",
        "controller.solve_limit_ms=20000",
        f"controller.compensation.initial_state='{initial_state}'",
    ]
    config = load_config(config_path, overrides)
    points, camera = config.leds.points, config.camera.mount
    method, random = make(config), np.random.default_rng(3)
    method.warm_up()
    goal = Goal(features_at(points, config.docking.goal(1), camera))
    pose, applied = pose_from_paper_start(4.0, -0.5, 0.3).inverse(), (0.0, 0.0)
    for frame in range(24 * 60):
        exact = docking_state(config, pose)
        noisy = features_at(points, pose, camera) + NOISE * random.standard_normal((len(points), 2))
        theta = pose.theta_rad + 0.005 * random.standard_normal()
        state = replace(
            exact,
            capture_ns=round(frame * FRAME_S * NS_PER_S),
            features=tuple((float(a), float(b)) for a, b in noisy),
            theta_homography_rad=theta,
        )
        method.observe(state, applied, applied)
        if frame % FRAMES_PER_COMMAND == 0:
            request = Request(
                now_ns=state.capture_ns, state=state, goal=goal, last_applied=applied, caps=CAPS, wheels=applied
            )
            plan, applied = method.plan(request)
            assert plan.usable
        pose = move_relative(pose, *applied, FRAME_S)
    ended = pose.inverse()
    assert abs(ended.x_m + 1.5) < 0.03
    assert abs(ended.y_m) < 0.02
    assert abs(ended.theta_rad) < np.radians(1.5)


def test_an_estimate_that_is_no_number_is_a_status(config_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = load_config(config_path, ["controller.method='paper_fatrop'", "controller.solve_limit_ms=20000"])
    method = make(config)
    method.warm_up()
    state = docking_state(config, Pose2(4.0, 0.2, 0.1))
    method.observe(state, (0.0, 0.0), None)
    monkeypatch.setattr(method._observer, "disturbance", np.full(9, np.nan))
    goal = Goal(features_at(config.leds.points, config.docking.goal(1), config.camera.mount))
    request = Request(now_ns=0, state=state, goal=goal, last_applied=(0.1, 0.0), caps=CAPS, wheels=None)
    plan, twist = method.plan(request)
    assert plan.status is PlanStatus.NUMERICAL_FAILURE
    assert twist == (0.0, 0.0)
