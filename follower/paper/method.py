"""The paper's method on the measured state: observer, nominal plan, compensation, saturation (Algorithm 1)."""

from __future__ import annotations

import numpy as np

from common.config import Config
from common.geometry import Array, extended_interaction_matrix
from common.messages import DockingState
from common.timing import NS_PER_S
from follower.controller.interface import (
    FeatureController,
    FeatureState,
    Plan,
    PlanStatus,
    Request,
    Velocity,
    failed_plan,
)
from follower.controller.limits import limited
from follower.paper import nmpc
from follower.paper.compensation import compensation
from follower.paper.eso import ExtendedStateObserver


class PaperMethod:
    """Sees every docking state, plans on some: features, θ of the homography and d̂, all through the observer."""

    source = "compensated"

    def __init__(self, config: Config, controller: FeatureController) -> None:
        self._config, self._controller = config, controller
        self._camera = config.camera.mount
        self._heights = self._camera[2] - config.leds.points[:, 2]
        self._observer = ExtendedStateObserver(self._heights, self._camera, config.controller.compensation)
        self._capture_ns: int | None = None

    def warm_up(self) -> None:
        """Solve typical problems once."""
        self._controller.warm_up()

    def reset(self) -> None:
        """Forget the observer and the last solution, as at the beginning of an approach."""
        self._capture_ns = None
        self._controller.reset()

    def observe(self, state: DockingState, last_applied: Velocity, wheels: Velocity | None) -> None:
        """Feed eq. (19), the extended state observer; what is not measured freezes the disturbance.

        Args:
            state: the newest docking state.
            last_applied: command (v [m/s], ω [rad/s]) in force since the last state.
            wheels: twist measured at the wheels, for ``observer_input = "wheel"``.
        """
        measured = _measured(state)
        if self._capture_ns is None:
            if np.isfinite(measured).all():
                self._observer.reset(measured)
                self._capture_ns = state.capture_ns
            return
        duration_s = (state.capture_ns - self._capture_ns) / NS_PER_S
        if duration_s <= 0:
            return
        by_command = self._config.controller.compensation.observer_input == "command" or wheels is None
        self._observer.update(measured, *(last_applied if by_command or wheels is None else wheels), duration_s)
        self._capture_ns = state.capture_ns

    def plan(self, request: Request) -> tuple[Plan, Velocity]:
        """The nominal plan of eq. (28) from the measured state, and u_F of eq. (31).

        u_F is the nominal input plus compensation, saturated; the rate limit is re-applied.
        """
        last, caps = request.last_applied, request.caps
        x = self._initial(request.state)
        features = x[:-1].reshape(-1, 2)
        plan = self._controller.solve(FeatureState(features, float(x[-1])), request.goal, last, caps)
        if not plan.usable:
            return plan, plan.first
        jacobian = extended_interaction_matrix(features, self._heights, self._camera)
        v, w = compensation(jacobian, self._observer.disturbance)
        if not np.isfinite([v, w]).all():
            return failed_plan(PlanStatus.NUMERICAL_FAILURE, len(plan.v_m_s), len(x)), (0.0, 0.0)
        return plan, limited((plan.first[0] + v, plan.first[1] + w), last, caps, self._config.limits)

    def _initial(self, state: DockingState) -> Array:
        """x_init: the observer's state; or as measured, and what is missing from the filtered state."""
        if self._config.controller.compensation.initial_state == "observer" and self._capture_ns is not None:
            return self._observer.state
        measured = _measured(state)
        filtered = np.append(np.array(state.features_filtered).reshape(-1), state.theta_rad)
        return np.where(np.isfinite(measured), measured, filtered)


def _measured(state: DockingState) -> Array:
    """y, (2n+1,): measured features and θ of the homography, NaN for what is missing."""
    features = [(np.nan, np.nan) if feature is None else feature for feature in state.features]
    theta = np.nan if state.theta_homography_rad is None else state.theta_homography_rad
    return np.append(np.array(features, dtype=float).reshape(-1), theta)


def make(config: Config) -> PaperMethod:
    """The paper's method of a configuration: ``paper_fatrop`` or ``paper_ipopt``, by the solver."""
    return PaperMethod(config, nmpc.make(config, "ipopt" if config.controller.method == "paper_ipopt" else "fatrop"))
