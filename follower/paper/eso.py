"""The paper's extended state observer of features, heading and lumped disturbance, eq. (19)."""

from __future__ import annotations

import numpy as np

from common.config import CompensationConfig
from common.geometry import Array, extended_interaction_matrix
from follower.paper.model import MOST_OFF_AXIS


class ExtendedStateObserver:
    """Gains from one bandwidth: L_1 = 2 ω_o I, L_2 = ω_o² I, so that every eigenvalue of A is −ω_o."""

    def __init__(self, height_difference_m: Array, camera_xyz_m: Array, config: CompensationConfig) -> None:
        self._heights, self._camera = height_difference_m, camera_xyz_m
        self._bandwidth = config.bandwidth_rad_s
        size = 2 * len(height_difference_m) + 1
        self._bound = np.append(np.full(size - 1, config.feature_bound), config.theta_bound_rad_s)
        self.state = np.zeros(size)
        self.disturbance = np.zeros(size)

    def reset(self, measured: Array) -> None:
        """Start at a measured state, undisturbed.

        Args:
            measured: (2n+1,) features and θ.
        """
        self.state = np.array(measured, dtype=float)
        self.disturbance = np.zeros_like(self.state)

    def update(self, measured: Array, v_m_s: float, w_rad_s: float, duration_s: float) -> None:
        """One Euler step of eq. (19), the extended state observer.

        The state is carried on to the time of the measurement before the two are compared: compared one frame too
        early, it would run one frame ahead of the robot.

        A measurement with anything missing (NaN) is invalid: the state then moves by the model alone and the
        disturbance is frozen. The estimate is bounded, so that it cannot wind up.

        Args:
            measured: y, (2n+1,): features and θ at the end of the step.
            v_m_s: input v during the step.
            w_rad_s: input ω during the step.
            duration_s: of the step.
        """
        valid = bool(np.isfinite(measured).all())
        at = measured if valid else self.state
        jacobian = extended_interaction_matrix(at[:-1].reshape(-1, 2), self._heights, self._camera)
        predicted = self.state + duration_s * (jacobian @ [v_m_s, w_rad_s] + self.disturbance)
        if not np.all(np.abs(predicted) <= MOST_OFF_AXIS):
            predicted = self.state  # unseen for so long that the model diverges: it says nothing any more
        innovation = measured - predicted if valid else np.zeros_like(predicted)
        self.state = predicted + duration_s * 2 * self._bandwidth * innovation
        estimate = self.disturbance + duration_s * self._bandwidth**2 * innovation
        self.disturbance = np.clip(estimate, -self._bound, self._bound)
