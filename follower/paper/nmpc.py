"""The paper's visual predictive control problem, eq. (28), as a CasADi NLP.

Solved by fatrop, an interior-point method for optimal control, or by IPOPT, the reference. The state it starts
from is handed in: whether measured or filtered is the caller's choice.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import casadi as ca
import numpy as np

from common.config import Config, ControllerConfig, LimitsConfig
from common.geometry import Array, Pinhole, Pose2, features_at
from follower.controller.interface import FeatureState, Goal, Plan, PlanStatus, SpeedCaps, Velocity, failed_plan
from follower.controller.limits import possible_request, reachable_bounds, visibility_bounds
from follower.controller.optimality import worst_complementarity
from follower.paper.model import MOST_OFF_AXIS, extended_state, flipped_features
from follower.paper.solver_process import Solution, SolverLostError, SolverProcess, SolveTooLongError
from follower.paper.transcription import Transcription

TOLERANCE = 1e-4
OPTIMALITY = 1e-4  # of the KKT residuals; both solvers end below 1e-6
_STATUSES: dict[int | str, PlanStatus] = {  # fatrop's IpSolverReturnFlag and IPOPT's names
    1: PlanStatus.ITERATION_LIMIT,
    3: PlanStatus.INFEASIBLE,
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
        built, self._slope, self._constraint_bounds = self._build(solver)
        self._solver = SolverProcess(built, controller.solve_limit_ms * 1e-3)
        self._warm: Array | None = None

    def warm_up(self) -> None:
        """Solve from three metres before the goal, twice: cold and from the first solution.

        Raises:
            DeviceError: the solver's process does not start.
        """
        self._solver.start()
        caps = SpeedCaps(
            v_min_m_s=self._limits.v_min_m_s, v_max_m_s=self._limits.v_max_m_s, w_max_rad_s=self._limits.w_max_rad_s
        )
        goal = Goal(features_at(self._points_l, Pose2(1.5, 0.0, 0.0), self._camera))
        start = Pose2(4.5, 0.3, 0.1)
        state = FeatureState(features_at(self._points_l, start, self._camera), start.theta_rad)
        for _ in range(2):
            self.solve(state, goal, (0.0, 0.0), caps)
        self.reset()

    def reset(self) -> None:
        """Forget the last solution."""
        self._warm = None

    def solve(self, state: FeatureState, goal: Goal, last_applied: Velocity, caps: SpeedCaps) -> Plan:
        """Solve eq. (28), the predictive problem, from x_init; see :class:`PredictiveController`.

        Args:
            state: x_init: features and θ.
            goal: where the plan leads.
            last_applied: command that u_0 may differ from by one step of the rate limit.
            caps: velocity bounds now.
        """
        shape, points = self._shape, (self._shape.points, 2)
        features = state.features
        start = extended_state(features, state.theta_rad)
        desired = goal.outputs()
        measured = np.shape(features) == np.shape(goal.features) == points and bool(
            np.all(np.abs(np.concatenate([start, desired])) <= MOST_OFF_AXIS)
        )
        if not measured or not possible_request(caps, last_applied, self._limits):
            return failed_plan(PlanStatus.INVALID_INPUT, shape.horizon, shape.state)
        if flipped_features(features, self._heights):
            return failed_plan(PlanStatus.FLIPPED_FEATURE, shape.horizon, shape.state)
        low, high = self._variable_bounds(caps, last_applied)
        guess = self._hold(start, last_applied) if self._warm is None else self._shifted(start, last_applied)
        parameters = np.concatenate([start, last_applied, desired])
        lower, upper = self._constraint_bounds
        self._warm = None
        try:
            answer = self._solver(x0=guess, p=parameters, lbx=low, ubx=high, lbg=lower, ubg=upper)
        except SolveTooLongError:
            return failed_plan(PlanStatus.TIME_LIMIT, shape.horizon, shape.state)
        except SolverLostError:
            return failed_plan(PlanStatus.NUMERICAL_FAILURE, shape.horizon, shape.state)
        iterations = int(answer.stats["iter_count"] or 0)
        if not answer.stats["success"] or not self._optimal(answer, parameters, low, high):
            status = _STATUSES.get(answer.stats["return_status"], PlanStatus.NUMERICAL_FAILURE)
            return failed_plan(status, shape.horizon, shape.state, iterations)
        return self._plan(answer.values["x"], float(answer.values["f"][0]), iterations)

    def _optimal(self, answer: Solution, parameters: Array, low: Array, high: Array) -> bool:
        """Trust no status: a solution counts only if it keeps its constraints and the optimality conditions."""
        x, g, lam_x, lam_g = (answer.values[name] for name in ("x", "g", "lam_x", "lam_g"))
        lower, upper = self._constraint_bounds
        if not all(np.isfinite(part).all() for part in (x, g, lam_x, lam_g)):
            return False
        violation = max((low - x).max(), (x - high).max(), (lower - g).max(), (g - upper).max())
        slope = np.asarray(self._slope(x, parameters, lam_g)).ravel() + lam_x
        looseness = max(worst_complementarity(lam_x, x, low, high), worst_complementarity(lam_g, g, lower, upper))
        return bool(violation <= TOLERANCE and np.abs(slope).max() <= OPTIMALITY and looseness <= OPTIMALITY)

    def _plan(self, solution: Array, objective: float, iterations: int) -> Plan:
        shape = self._shape
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

    def _build(self, solver: str) -> tuple[ca.Function, ca.Function, tuple[Array, Array]]:
        """The NLP solver, the slope of the Lagrangian, and the bounds of the constraints."""
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
        bounds = np.array(nlp.lower), np.array(nlp.upper)
        return ca.nlpsol("paper_nmpc", solver, problem, options), nlp.lagrangian_slope(), bounds

    def _variable_bounds(self, caps: SpeedCaps, last_applied: Velocity) -> tuple[Array, Array]:
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

    def _hold(self, start: Array, last_applied: Velocity) -> Array:
        """A cold guess: the state stays as it is."""
        stage = np.concatenate([start, last_applied, last_applied, [0.0]])
        return np.concatenate([np.tile(stage, self._shape.horizon), start, last_applied, [0.0]])

    def _shifted(self, start: Array, last_applied: Velocity) -> Array:
        """The last solution one period later, begun at the new state, its last input held."""
        assert self._warm is not None
        shape = self._shape
        stages = self._warm[: shape.stage * shape.horizon].reshape(shape.horizon, shape.stage)
        terminal = self._warm[shape.stage * shape.horizon :]
        held = np.concatenate([terminal[:-1], terminal[-3:-1], [0.0]])
        guess = np.concatenate([stages[1:].ravel(), held, terminal])
        guess[: shape.state + 2] = np.concatenate([start, last_applied])
        return guess


def make(config: Config, solver: Literal["fatrop", "ipopt"]) -> PaperNmpc:
    """The paper's controller of a configuration with one of its two solvers."""
    return PaperNmpc(
        config.leds.points, config.camera.mount, config.camera.pinhole, config.controller, config.limits, solver
    )
