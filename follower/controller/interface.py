"""What a predictive controller is given, what it answers, and what a docking method offers beyond it.

A controller is pure: it keeps only its warm start, reads no clock and starts no thread. A solve that fails is
a status in the plan, never an exception; whether it came too late is for its caller to judge.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Protocol, TypeVar

import numpy as np

from common.geometry import Array, Pose2
from common.messages import DockingState
from follower.model.motion import NO_DISTURBANCE, MotionDisturbance

Velocity = tuple[float, float]  # v [m/s], ω [rad/s] of {F}
StateT = TypeVar("StateT", contravariant=True)


class PlanStatus(Enum):
    """How a solve ended; only ``SOLVED`` plans may be driven."""

    SOLVED = "solved"
    ITERATION_LIMIT = "iteration_limit"
    TIME_LIMIT = "time_limit"
    INFEASIBLE = "infeasible"
    NUMERICAL_FAILURE = "numerical_failure"
    FLIPPED_FEATURE = "flipped_feature"
    INVALID_INPUT = "invalid_input"


@dataclass(frozen=True, kw_only=True)
class SpeedCaps:
    """Bounds of the velocity command; they may lower the configured limits, never raise them."""

    v_min_m_s: float
    v_max_m_s: float
    w_max_rad_s: float


@dataclass(frozen=True)
class Goal:
    """Where to arrive.

    Attributes:
        features: s*, (n, 2) normalised.
        theta_rad: θ*, zero in the paper.
    """

    features: Array
    theta_rad: float = 0.0

    def outputs(self) -> Array:
        """``[s*, θ*]``, (2n+1,)."""
        return np.append(np.asarray(self.features, dtype=float).reshape(-1), self.theta_rad)


@dataclass(frozen=True)
class MotionState:
    """What the default method plans from.

    Attributes:
        leader_in_follower: pose of {L} in {F} when the next command takes effect.
        disturbance: to predict with.
        wheels: twist measured at the wheels, from which they follow the command with a lag; None: as commanded.
    """

    leader_in_follower: Pose2
    disturbance: MotionDisturbance = NO_DISTURBANCE
    wheels: Velocity | None = None


@dataclass(frozen=True)
class FeatureState:
    """What the paper's method plans from, its x_init.

    Attributes:
        features: (n, 2) normalised.
        theta_rad: θ_L^F.
    """

    features: Array
    theta_rad: float


@dataclass(frozen=True)
class Plan:
    """The optimal control sequence and what the model expects of it.

    Attributes:
        status: how the solve ended.
        v_m_s, w_rad_s: (N_p,) nominal inputs ū_0 … ū_{N_p−1}; zeros when there is no solution.
        objective: cost of eq. (28a) at the solution, with the penalty for features out of view.
        iterations: of the solver.
        states: (N_p + 1, m) predicted states; m = 2n+1 features and θ for the paper's, x, y, θ for ``davpc``.
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
    def first(self) -> Velocity:
        """ū_0: v [m/s], ω [rad/s]."""
        return float(self.v_m_s[0]), float(self.w_rad_s[0])


def failed_plan(status: PlanStatus, horizon: int, state_size: int, iterations: int = 0) -> Plan:
    """A plan that says only why there is none.

    Args:
        status: why.
        horizon: N_p.
        state_size: m, of the predicted states.
        iterations: of the solver.
    """
    zeros = np.zeros(horizon)
    return Plan(status, zeros, zeros, float("nan"), iterations, np.full((horizon + 1, state_size), np.nan))


class PredictiveController(Protocol[StateT]):
    """Solves the docking problem from one state; keeps its last solution to start the next from."""

    def warm_up(self) -> None:
        """Solve typical problems once: the first solve of a process takes many times the later ones."""

    def reset(self) -> None:
        """Forget the warm start, as at the beginning of an approach."""

    def solve(self, state: StateT, goal: Goal, last_applied: Velocity, caps: SpeedCaps) -> Plan:
        """Plan from a state.

        Args:
            state: where the plan begins.
            goal: where it leads.
            last_applied: command that u_0 may differ from by one step of the rate limit.
            caps: velocity bounds now.
        """


PoseController = PredictiveController[MotionState]
FeatureController = PredictiveController[FeatureState]


@dataclass(frozen=True, kw_only=True)
class Request:
    """One command that is due.

    Attributes:
        now_ns: the time.
        state: the newest docking state, valid.
        goal: of the mission.
        last_applied: the command published last.
        caps: velocity bounds of the mission.
        wheels: twist measured at the wheels, None if it is not known.
    """

    now_ns: int
    state: DockingState
    goal: Goal
    last_applied: Velocity
    caps: SpeedCaps
    wheels: Velocity | None


class DockingMethod(Protocol):
    """A method of visual servoing: what it takes from each docking state, and what it commands.

    ``source`` names its commands in logs.
    """

    source: str

    def warm_up(self) -> None:
        """Solve typical problems once, before anything can be armed."""

    def reset(self) -> None:
        """Forget all, as at the beginning of an approach."""

    def observe(self, state: DockingState, last_applied: Velocity, wheels: Velocity | None) -> None:
        """Take a valid docking state, also one on which no command is due.

        Args:
            state: the newest.
            last_applied: command in force since the state before.
            wheels: twist measured at the wheels, None if it is not known.
        """

    def plan(self, request: Request) -> tuple[Plan, Velocity]:
        """Plan the inputs of the next periods; with the command, within caps and rate limit, if it is usable."""
