"""The paper's method on the measured state: observer, nominal plan, compensation, saturation (Algorithm 1)."""

from __future__ import annotations

import numpy as np

from common.config import Config
from common.geometry import Array, Pose2, extended_interaction_matrix
from common.messages import DockingState
from common.timing import NS_PER_S
from follower.controller.interface import Plan, PredictiveController, SpeedCaps
from follower.paper.compensation import compensation, limited
from follower.paper.eso import ExtendedStateObserver


class PaperMethod:
    """Sees every docking state, plans on some: features as measured, θ of the homography, d̂ of the observer."""

    def __init__(self, config: Config, solver: PredictiveController) -> None:
        self._config, self._solver = config, solver
        self._camera = config.camera.mount
        self._heights = self._camera[2] - config.leds.points[:, 2]
        self._observer = ExtendedStateObserver(self._heights, self._camera, config.controller.compensation)
        self._capture_ns: int | None = None

    def reset(self) -> None:
        """Forget the observer, as at the beginning of an approach."""
        self._capture_ns = None

    def observe(self, state: DockingState, applied: tuple[float, float], wheels: tuple[float, float] | None) -> None:
        """Feed eq. (eso); what is not measured freezes the disturbance.

        Args:
            state: the newest docking state.
            applied: command (v [m/s], ω [rad/s]) in force since the last state.
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
        self._observer.update(measured, *(applied if by_command or wheels is None else wheels), duration_s)
        self._capture_ns = state.capture_ns

    def plan(
        self, state: DockingState, desired: Array, goal_theta_rad: float, last: tuple[float, float], caps: SpeedCaps
    ) -> Plan:
        """The nominal plan from the measured state, eq. (nmpc_problem)."""
        x = self._initial(state)
        features, theta = x[:-1].reshape(-1, 2), float(x[-1])
        pose = Pose2(state.x_m, state.y_m, theta)
        return self._solver.solve(pose, features, theta, desired, goal_theta_rad, last, caps)

    def compensated(
        self, state: DockingState, nominal: tuple[float, float], last: tuple[float, float], caps: SpeedCaps
    ) -> tuple[float, float]:
        """u_F of eq. (getuf), with the rate limit re-applied."""
        features = self._initial(state)[:-1].reshape(-1, 2)
        jacobian = extended_interaction_matrix(features, self._heights, self._camera)
        v, w = compensation(jacobian, self._observer.disturbance)
        return limited((nominal[0] + v, nominal[1] + w), last, caps, self._config.limits)

    def _initial(self, state: DockingState) -> Array:
        """x_init: as measured; what is missing from the filtered state."""
        measured = _measured(state)
        filtered = np.append(np.array(state.features_filtered).reshape(-1), state.theta_rad)
        return np.where(np.isfinite(measured), measured, filtered)


def _measured(state: DockingState) -> Array:
    """y, (2n+1,): measured features and θ of the homography, NaN for what is missing."""
    features = [(np.nan, np.nan) if feature is None else feature for feature in state.features]
    theta = np.nan if state.theta_homography_rad is None else state.theta_homography_rad
    return np.append(np.array(features, dtype=float).reshape(-1), theta)
