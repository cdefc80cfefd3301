"""What every predictive controller offers, and how one is chosen by name.

A controller is pure: it keeps only its warm start, reads no clock and starts no thread. A solve that fails is
a status in the plan, never an exception; whether it came too late is for its caller to judge.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from importlib import import_module
from typing import Protocol

import numpy as np

from common.config import Config
from common.errors import ConfigError
from common.geometry import Array, Pose2
from follower.model.motion import NO_DISTURBANCE, MotionDisturbance


class PlanStatus(Enum):
    """How a solve ended; only ``SOLVED`` plans may be driven."""

    SOLVED = "solved"
    ITERATION_LIMIT = "iteration_limit"
    INFEASIBLE = "infeasible"
    NUMERICAL_FAILURE = "numerical_failure"
    FLIPPED_FEATURE = "flipped_feature"
    INVALID_INPUT = "invalid_input"


@dataclass(frozen=True)
class SpeedCaps:
    """Bounds of the velocity command; they may lower the configured limits, never raise them."""

    v_min_m_s: float
    v_max_m_s: float
    w_max_rad_s: float


@dataclass(frozen=True)
class Plan:
    """The optimal control sequence and what the model expects of it.

    Attributes:
        status: how the solve ended.
        v_m_s, w_rad_s: (N_p,) nominal inputs ū_0 … ū_{N_p−1}; zeros when there is no solution.
        objective: value of eq. (nmpc_problem) at the solution, with the penalty for features out of view.
        iterations: of the solver.
        states: (N_p + 1, m) predicted states; m = 2n+1 features and θ for ``paper``, x, y, θ for ``davpc``.
    """

    status: PlanStatus
    v_m_s: Array
    w_rad_s: Array
    objective: float
    iterations: int
    states: Array

    @property
    def usable(self) -> bool:
        """Whether the plan may be driven."""
        return self.status is PlanStatus.SOLVED

    @property
    def first(self) -> tuple[float, float]:
        """ū_0: v [m/s], ω [rad/s]."""
        return float(self.v_m_s[0]), float(self.w_rad_s[0])


def failed_plan(status: PlanStatus, horizon: int, state_size: int, iterations: int = 0) -> Plan:
    """A plan that says only why there is none."""
    zeros = np.zeros(horizon)
    return Plan(status, zeros, zeros, float("nan"), iterations, np.full((horizon + 1, state_size), np.nan))


class PredictiveController(Protocol):
    """Solves the docking problem from one state; keeps its last solution to start the next from."""

    def warm_up(self) -> None:
        """Solve typical problems once: the first solve of a process takes many times the later ones."""

    def reset(self) -> None:
        """Forget the warm start, as at the beginning of an approach."""

    def solve(
        self,
        pose: Pose2,
        features: Array,
        theta_rad: float,
        desired_features: Array,
        desired_theta_rad: float,
        last_applied: tuple[float, float],
        caps: SpeedCaps,
        disturbance: MotionDisturbance = NO_DISTURBANCE,
        wheels: tuple[float, float] | None = None,
    ) -> Plan:
        """Plan from the state at which the next command takes effect.

        Args:
            pose: estimated pose of {L} in {F}; what ``davpc`` starts from.
            features: (n, 2) normalised features and
            theta_rad: θ_L^F; what ``paper`` starts from (its x_init).
            desired_features: (n, 2) s*.
            desired_theta_rad: θ*, zero in the paper.
            last_applied: command v [m/s], ω [rad/s] that u_0 may differ from by one step of the rate limit.
            caps: velocity bounds now.
            disturbance: for methods that predict with it.
            wheels: twist measured at the wheels, for methods that predict their lag; None: as commanded.
        """


_FACTORIES = {
    "gauss_newton": ("follower.controller.realtime", "make"),
    "fatrop": ("follower.paper.nmpc", "make"),
    "ipopt": ("follower.paper.nmpc", "make"),
}


def solver_names() -> tuple[str, ...]:
    """Names that ``controller.solver`` may have."""
    return tuple(_FACTORIES)


def make_controller(config: Config) -> PredictiveController:
    """The controller that ``controller.solver`` names; its module is imported only now.

    Raises:
        ConfigError: there is no such solver.
    """
    name = config.controller.solver
    if name not in _FACTORIES:
        raise ConfigError(f"controller.solver: {name!r} is none of {', '.join(_FACTORIES)}")
    module, attribute = _FACTORIES[name]
    factory: Callable[[Config], PredictiveController] = getattr(import_module(module), attribute)
    return factory(config)
