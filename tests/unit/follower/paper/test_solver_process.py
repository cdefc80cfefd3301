"""Every solve ends: also the one that fatrop itself never ends."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from common.config import default_config_path, load_config
from common.errors import DeviceError
from common.geometry import Pose2, features_at
from experiments.feature_level.pilots import PilotFactory
from experiments.feature_level.scenes import method_config
from experiments.feature_level.trial import goal_task
from follower.controller.interface import FeatureState, Goal, PlanStatus, SpeedCaps
from follower.paper import nmpc, solver_process
from follower.paper.solver_process import SolverLostError, SolverProcess, SolveTooLongError

ENDLESS = Path(__file__).parent / "solve_without_end.npz"
LIMIT_S = 1.0


def small_solver() -> ca.Function:
    """min (x − p)², |x| ≤ 1."""
    x, p = ca.SX.sym("x"), ca.SX.sym("p")
    quiet: dict[str, Any] = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"}
    return ca.nlpsol("small", "ipopt", {"x": x, "p": p, "f": (x - p) ** 2}, quiet)


def small_problem(wanted: float) -> dict[str, np.ndarray]:
    return {name: np.array([value]) for name, value in (("x0", 0.0), ("p", wanted), ("lbx", -1.0), ("ubx", 1.0))}


def test_answers_are_the_solvers_own() -> None:
    solver = SolverProcess(small_solver(), LIMIT_S)
    solver.start()
    for wanted, expected in ((0.25, 0.25), (3.0, 1.0)):
        answer = solver(**small_problem(wanted))
        assert answer.values["x"] == pytest.approx([expected], abs=1e-6)
        assert answer.stats["success"]


def test_a_solve_without_end_is_ended_and_the_next_one_is_solved() -> None:
    config = load_config(default_config_path())
    config = config.model_copy(
        update={"controller": config.controller.model_copy(update={"solve_limit_ms": 1e3 * LIMIT_S})}
    )
    config = config.model_copy(update={"leds": method_config(config, "paper").leds})
    controller = nmpc.make(config, "fatrop")
    controller.warm_up()
    begin_s = time.monotonic()
    with np.load(ENDLESS) as endless, pytest.raises(SolveTooLongError):
        controller._solver(**dict(endless))
    assert LIMIT_S <= time.monotonic() - begin_s < 30.0
    controller.warm_up()
    points, camera = config.leds.points, config.camera.mount
    pose = Pose2(4.0, 0.4, 0.1)
    goal = Goal(features_at(points, config.docking.goal(1), camera))
    caps = SpeedCaps(v_min_m_s=-0.1, v_max_m_s=0.5, w_max_rad_s=0.6)
    plan = controller.solve(FeatureState(features_at(points, pose, camera), pose.theta_rad), goal, (0.0, 0.0), caps)
    assert plan.status is PlanStatus.SOLVED


def test_the_experiments_problem_is_the_one_that_never_ends() -> None:
    """The recorded call, eq. (28) from a state that has diverged, is still what the controller would ask."""
    task = goal_task(method_config(load_config(default_config_path()), "paper"))
    controller = PilotFactory("paper", task)._papers
    assert controller is not None
    with np.load(ENDLESS) as endless:
        start, applied, desired = np.split(endless["p"], [9, 11])
        np.testing.assert_allclose(desired[:-1], task.desired.reshape(-1), atol=1e-9)
        caps = task.caps
        low, high = controller._variable_bounds(caps, (float(applied[0]), float(applied[1])))
        np.testing.assert_allclose(low, endless["lbx"])
        np.testing.assert_allclose(high, endless["ubx"])
    assert np.abs(start).max() > 20.0


def test_a_lost_process_is_replaced() -> None:
    solver = SolverProcess(small_solver(), 60.0)
    solver.start()
    assert solver._child is not None
    os.kill(solver._child.pid, signal.SIGKILL)
    with pytest.raises(SolverLostError):
        solver(**small_problem(0.5))
    assert solver(**small_problem(0.5)).values["x"] == pytest.approx([0.5], abs=1e-6)


def test_no_process_is_left_behind() -> None:
    solver = SolverProcess(small_solver(), LIMIT_S)
    solver.start()
    assert solver._child is not None
    pid = solver._child.pid
    del solver
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_a_process_that_does_not_start_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    broken = tmp_path / "solver_child.py"
    broken.write_text("raise SystemExit(3)\n")
    monkeypatch.setattr(solver_process, "_CHILD", broken)
    with pytest.raises(DeviceError, match="solver's process"):
        SolverProcess(small_solver(), LIMIT_S).start()
