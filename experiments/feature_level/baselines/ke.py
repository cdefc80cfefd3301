"""Ke et al. 2017, reconstructed from its citation: one point and θ, chained form, predictive control.

The goal's place in {F} follows from the point's depth Δh/β and from θ; with the heading it makes the chained form
ẏ = x θ̇. All three are driven to zero by a quadratic stage cost over a short horizon, within the velocity bounds.
There is no field-of-view constraint and no rate limit. Weights are a reconstruction too.
"""

from __future__ import annotations

import daqp
import numpy as np

from common.geometry import Array

HORIZON = 20
PERIOD_S = 0.05
STATE_WEIGHT = np.array([0.1, 1.0, 10.0])  # of θ and of the goal's x and y
INPUT_WEIGHT = 0.3
NEWTON_STEPS = 3


def goal_in_follower(
    feature: Array, theta_rad: float, height_difference_m: float, goal_to_point_m: Array, camera_xyz_m: Array
) -> Array:
    """``[θ, x, y]``: heading, and place of the goal in {F}.

    Args:
        feature: (2,) normalised, of one point; its depth is Δh/β.
        theta_rad: measured θ_L^F.
        goal_to_point_m: (2,) from the goal to that point, on the floor, in the goal's axes.
    """
    depth = height_difference_m / feature[1]
    c, s = np.cos(theta_rad), np.sin(theta_rad)
    point = np.array([depth + camera_xyz_m[0], camera_xyz_m[1] - feature[0] * depth])
    x, y = point - np.array([[c, -s], [s, c]]) @ goal_to_point_m
    return np.array([theta_rad, x, y])


class KeController:
    """Keeps the last solution to start from."""

    def __init__(self, v_bounds: tuple[float, float], w_max: float) -> None:
        self._lower = np.repeat([v_bounds[0], -w_max], HORIZON)
        self._upper = np.repeat([v_bounds[1], w_max], HORIZON)
        self._inputs = np.zeros(2 * HORIZON)

    def solve(self, state: Array) -> tuple[float, float]:
        """Velocity v [m/s], ω [rad/s].

        Args:
            state: (3,) ``[θ, x, y]``, heading [rad] and place of the goal in {F} [m].
        """
        inputs = np.concatenate([np.append(half[1:], half[-1]) for half in self._inputs.reshape(2, -1)])
        for _ in range(NEWTON_STEPS):
            states, by_inputs = _roll_out(state, inputs)
            weights = np.tile(STATE_WEIGHT, HORIZON)
            weighted = by_inputs.T * weights
            hessian = weighted @ by_inputs + INPUT_WEIGHT * np.eye(2 * HORIZON)
            gradient = weighted @ (states - by_inputs @ inputs)
            solution, _, flag, _ = daqp.solve(hessian, gradient, np.empty((0, 2 * HORIZON)), self._upper, self._lower)
            if flag <= 0:
                return 0.0, 0.0
            inputs = solution
        self._inputs = inputs
        return float(inputs[0]), float(inputs[HORIZON])


def _roll_out(start: Array, inputs: Array) -> tuple[Array, Array]:
    """States of all stages, stacked (3N,), and their derivatives by [v…, ω…], (3N, 2N); forward Euler."""
    v, w = inputs.reshape(2, -1)
    state, slope = start, np.zeros((3, 2 * HORIZON))
    states, slopes = np.empty((HORIZON, 3)), np.empty((HORIZON, 3, 2 * HORIZON))
    for k in range(HORIZON):
        _, x, y = state
        by_state = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, PERIOD_S * w[k]], [0.0, -PERIOD_S * w[k], 1.0]])
        slope = by_state @ slope
        slope[1, k] -= PERIOD_S
        slope[:, HORIZON + k] += PERIOD_S * np.array([-1.0, y, -x])
        state = state + PERIOD_S * np.array([-w[k], y * w[k] - v[k], -x * w[k]])
        states[k], slopes[k] = state, slope
    return states.reshape(-1), slopes.reshape(-1, 2 * HORIZON)
