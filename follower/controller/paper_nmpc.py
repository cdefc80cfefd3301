"""The paper's visual predictive control problem, eq. (nmpc_problem), as a CasADi NLP.

Solved by fatrop, an interior-point method for optimal control, or by IPOPT, the reference. The state it starts
from is handed in: whether measured or filtered is the caller's choice.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from common.config import Config, ControllerConfig, LimitsConfig
from common.geometry import Array, Pinhole, Pose2, features_at
from follower.controller.interface import (
    Plan,
    PlanStatus,
    SpeedCaps,
    failed_plan,
)
from follower.controller.limits import reachable_bounds
from follower.controller.model import extended_state, flipped_features
from follower.controller.transcription import Transcription
from follower.motion import NO_DISTURBANCE, MotionDisturbance

TOLERANCE = 1e-4
_STATUSES = {
    "Maximum_Iterations_Exceeded": PlanStatus.ITERATION_LIMIT,
    "Infeasible_Problem_Detected": PlanStatus.INFEASIBLE,
}


@dataclass(frozen=True)
class ProblemShape:
    """Sizes of the NLP's variables: n points, horizon N_p."""

    points: int
    horizon: int

    @property
    def state(self) -> int:
        """2n+1."""
        return 2 * self.points + 1

    @property
    def stage(self) -> int:
        """Variables of one stage: x_k, u_{k−1}, u_k, σ_k."""
        return self.state + 5

    @property
    def variables(self) -> int:
        """All stages, and the terminal one without u."""
        return self.stage * self.horizon + self.state + 3


def visibility_bounds(pinhole: Pinhole, margin_px: float, points: int) -> tuple[Array, Array]:
    """s_min, s_max of eq. (nmpc_problem): (2n,) each, the image less a margin."""
    corners = np.array([[margin_px, margin_px], [pinhole.width_px - 1, pinhole.height_px - 1]])
    corners[1] -= margin_px
    low, high = pinhole.to_normalised(corners)
    return np.tile(low, points), np.tile(high, points)


class PaperNmpc:
    """The paper's NMPC with an interior-point solver: fatrop, or IPOPT as the reference."""

    def __init__(
        self,
        points_l: Array,
        camera_xyz_m: Array,
        pinhole: Pinhole,
        controller: ControllerConfig,
        limits: LimitsConfig,
        solver: str,
    ) -> None:
        self._points_l = points_l
        self._camera = camera_xyz_m
        self._heights = camera_xyz_m[2] - points_l[:, 2]
        self._config = controller
        self._limits = limits
        self._shape = ProblemShape(len(points_l), controller.horizon)
        self._visible = visibility_bounds(pinhole, controller.visibility_margin_px, len(points_l))
        self._solver, self._constraint_bounds = self._build(solver)
        self._warm: Array | None = None

    def warm_up(self) -> None:
        """Solve from three metres before the goal, twice: cold and from the first solution."""
        caps = SpeedCaps(self._limits.v_min_m_s, self._limits.v_max_m_s, self._limits.w_max_rad_s)
        goal = features_at(self._points_l, Pose2(1.5, 0.0, 0.0), self._camera)
        start = Pose2(4.5, 0.3, 0.1)
        features = features_at(self._points_l, start, self._camera)
        for _ in range(2):
            self.solve(start, features, start.theta_rad, goal, 0.0, (0.0, 0.0), caps)
        self.reset()

    def reset(self) -> None:
        """Forget the last solution."""
        self._warm = None

    def solve(
        self,
        pose: Pose2,  # noqa: ARG002 - the paper's state is features and θ
        features: Array,
        theta_rad: float,
        desired_features: Array,
        desired_theta_rad: float,
        last_applied: tuple[float, float],
        caps: SpeedCaps,
        disturbance: MotionDisturbance = NO_DISTURBANCE,  # noqa: ARG002 - the nominal model has none
        wheels: tuple[float, float] | None = None,  # noqa: ARG002 - nor a lag
    ) -> Plan:
        """Solve eq. (nmpc_problem) from x_init = [features, θ]; see :class:`PredictiveController`."""
        shape = self._shape
        start = extended_state(features, theta_rad)
        desired = extended_state(desired_features, desired_theta_rad)
        if not (np.isfinite(start).all() and np.isfinite(desired).all() and start.size == shape.state):
            return failed_plan(PlanStatus.INVALID_INPUT, shape.horizon, shape.state)
        if flipped_features(features, self._heights):
            return failed_plan(PlanStatus.FLIPPED_FEATURE, shape.horizon, shape.state)
        low, high = self._variable_bounds(caps, last_applied)
        guess = self._hold(start, last_applied) if self._warm is None else self._shifted(start, last_applied)
        solution = self._solver(
            x0=guess,
            p=np.concatenate([start, last_applied, desired]),
            lbx=low,
            ubx=high,
            lbg=self._constraint_bounds[0],
            ubg=self._constraint_bounds[1],
        )
        values, residuals = np.asarray(solution["x"]).ravel(), np.asarray(solution["g"]).ravel()
        lower, upper = self._constraint_bounds
        worst = max((low - values).max(), (values - high).max(), (lower - residuals).max(), (residuals - upper).max())
        return self._plan(values, float(worst), float(solution["f"]), self._solver.stats())

    def _plan(self, solution: Array, worst_violation: float, objective: float, stats: dict[str, Any]) -> Plan:
        """Trust no status alone: a solution counts only if it also keeps its constraints."""
        shape = self._shape
        iterations = int(stats.get("iter_count", 0))
        kept = bool(np.isfinite(solution).all()) and worst_violation <= TOLERANCE
        if not stats["success"] or not kept:
            self._warm = None
            status = _STATUSES.get(str(stats["return_status"]), PlanStatus.NUMERICAL_FAILURE)
            return failed_plan(status, shape.horizon, shape.state, iterations)
        self._warm = solution
        stages = solution[: shape.stage * shape.horizon].reshape(shape.horizon, shape.stage)
        terminal = solution[shape.stage * shape.horizon :][: shape.state]
        return Plan(
            PlanStatus.SOLVED,
            stages[:, shape.state + 2].copy(),
            stages[:, shape.state + 3].copy(),
            objective,
            iterations,
            np.vstack([stages[:, : shape.state], terminal]),
        )

    def _build(self, solver: str) -> tuple[ca.Function, tuple[Array, Array]]:
        """The NLP solver and the bounds of its constraints."""
        nlp = Transcription(self._config, self._limits, self._heights, self._camera, self._visible)
        problem = {
            "x": ca.vertcat(*nlp.variables),
            "p": nlp.parameters,
            "f": nlp.cost,
            "g": ca.vertcat(*nlp.constraints),
        }
        options: dict[str, Any] = {"print_time": False, "error_on_fail": False}
        if solver == "fatrop":
            options |= {
                "structure_detection": "auto",
                "equality": nlp.equality,
                "fatrop": {"print_level": 0, "max_iter": 100, "tol": 1e-6, "mu_init": 1e-3},
            }
        else:
            options["ipopt"] = {"print_level": 0, "sb": "yes", "max_iter": 200, "tol": 1e-7}
        return ca.nlpsol("paper_nmpc", solver, problem, options), (np.array(nlp.lower), np.array(nlp.upper))

    def _variable_bounds(self, caps: SpeedCaps, last_applied: tuple[float, float]) -> tuple[Array, Array]:
        """Bounds of u and σ; a cap below the speed now driven is reached as fast as the rate limit allows."""
        shape = self._shape
        low = np.full(shape.variables, -np.inf)
        high = np.full(shape.variables, np.inf)
        slack = np.arange(shape.horizon) * shape.stage + shape.state + 4
        low[slack], low[-1] = 0.0, 0.0
        v_low, v_high, w_low, w_high = reachable_bounds(caps, last_applied, self._limits, shape.horizon)
        low[slack - 2], high[slack - 2] = v_low, v_high
        low[slack - 1], high[slack - 1] = w_low, w_high
        return low, high

    def _hold(self, start: Array, last_applied: tuple[float, float]) -> Array:
        """A cold guess: the state stays as it is."""
        stage = np.concatenate([start, last_applied, last_applied, [0.0]])
        return np.concatenate([np.tile(stage, self._shape.horizon), start, last_applied, [0.0]])

    def _shifted(self, start: Array, last_applied: tuple[float, float]) -> Array:
        """The last solution one period later, begun at the new state, its last input held."""
        assert self._warm is not None
        shape = self._shape
        stages = self._warm[: shape.stage * shape.horizon].reshape(shape.horizon, shape.stage)
        terminal = self._warm[shape.stage * shape.horizon :]
        held = np.concatenate([terminal[:-1], terminal[-3:-1], [0.0]])
        guess = np.concatenate([stages[1:].ravel(), held, terminal])
        guess[: shape.state + 2] = np.concatenate([start, last_applied])
        return guess


def make(config: Config) -> PaperNmpc:
    """The controller of a configuration; ``controller.solver`` is ``fatrop`` or ``ipopt``."""
    return PaperNmpc(
        config.leds.points,
        config.camera.mount,
        config.camera.pinhole,
        config.controller,
        config.limits,
        config.controller.solver,
    )
