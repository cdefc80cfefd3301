"""Ke et al. 2017, reconstructed from its citation: one point and θ, chained form, predictive control.

The goal's place in {F} follows from the point's depth Δh/β and from θ; with the heading it makes the chained form
ẏ = x θ̇. All three are driven to zero by a quadratic stage cost over a short horizon, within the velocity bounds.
There is no field-of-view constraint. The rate limit of all methods is added: without it the method would be given a
robot that the others do not have. The weights are a reconstruction; :mod:`experiments.tuning` searches others.
"""

from __future__ import annotations

from dataclasses import dataclass

import daqp
import numpy as np

from common.config import LimitsConfig
from common.geometry import Array

HORIZON = 20
PERIOD_S = 0.05
NEWTON_STEPS = 3
FARTHEST = 1e3  # m, rad: what is farther, or not a number, is no place of the goal
MOST_ITERATIONS = 1000  # of daqp


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


@dataclass(frozen=True, kw_only=True)
class KeWeights:
    """Of the stage cost: heading, the goal's x and y in {F}, and the inputs."""

    theta: float
    x: float
    y: float
    effort_v: float
    effort_w: float


class KeController:
    """Keeps the last solution to start from."""

    def __init__(self, limits: LimitsConfig, weights: KeWeights) -> None:
        self._lower = np.repeat([limits.v_min_m_s, -limits.w_max_rad_s], HORIZON)
        self._upper = np.repeat([limits.v_max_m_s, limits.w_max_rad_s], HORIZON)
        self._state_weight = np.tile([weights.theta, weights.x, weights.y], HORIZON)
        self._effort = np.diag(np.repeat([weights.effort_v, weights.effort_w], HORIZON))
        change = np.eye(HORIZON) - np.eye(HORIZON, k=-1)  # of an input against the one before
        self._change = np.kron(np.eye(2), change)
        self._steps = np.repeat([limits.controller_dv_m_s, limits.controller_dw_rad_s], HORIZON)
        self._inputs = np.zeros(2 * HORIZON)

    def solve(self, state: Array, last_applied: tuple[float, float]) -> tuple[float, float]:
        """Velocity v [m/s], ω [rad/s]; standstill where there is no solution.

        Args:
            state: (3,) ``[θ, x, y]``, heading [rad] and place of the goal in {F} [m].
            last_applied: command that the first input may differ from by one step of the rate limit.
        """
        if not np.all(np.abs(state) <= FARTHEST):
            return 0.0, 0.0
        inputs = np.concatenate([np.append(half[1:], half[-1]) for half in self._inputs.reshape(2, -1)])
        before = np.zeros(2 * HORIZON)
        before[[0, HORIZON]] = last_applied
        upper = np.concatenate([self._upper, before + self._steps])
        lower = np.concatenate([self._lower, before - self._steps])
        for _ in range(NEWTON_STEPS):
            states, by_inputs = _roll_out(state, inputs)
            weighted = by_inputs.T * self._state_weight
            hessian = weighted @ by_inputs + self._effort
            gradient = weighted @ (states - by_inputs @ inputs)
            if not (np.isfinite(hessian).all() and np.isfinite(gradient).all()):
                return 0.0, 0.0
            solution, _, flag, _ = daqp.solve(
                hessian, gradient, self._change, upper, lower, iter_limit=MOST_ITERATIONS
            )
            if flag <= 0 or not np.isfinite(solution).all():
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
