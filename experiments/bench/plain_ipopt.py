"""The paper's problem as a CasADi user would first write it: MX, multiple shooting, IPOPT, a cold start each time.

The yardstick of ``davpc bench control``: hard visibility constraints, u_0 free, as in eq. (28).
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from common.config import Config
from common.geometry import Array
from follower.controller.interface import FeatureState, Goal, Plan, PlanStatus, SpeedCaps, failed_plan
from follower.controller.limits import visibility_bounds
from follower.paper.model import extended_state

MOST_S = 60.0  # of a solve


class PlainIpopt:
    """Through ``casadi.Opti``, without any tuning."""

    def __init__(self, config: Config) -> None:
        self._config = config
        self._size = 2 * len(config.leds.points) + 1
        self._build()

    def solve(self, state: FeatureState, goal: Goal, caps: SpeedCaps) -> Plan:
        """Solve from the state; see :class:`PredictiveController`. The paper leaves u_0 free."""
        start = extended_state(state.features, state.theta_rad)
        opti = self._opti
        opti.set_value(self._start, start)
        opti.set_value(self._desired, goal.outputs())
        opti.set_value(self._bounds, [caps.v_min_m_s, caps.v_max_m_s, caps.w_max_rad_s])
        opti.set_initial(self._x, np.tile(start[:, None], (1, self._config.controller.horizon + 1)))
        opti.set_initial(self._u, 0.0)
        try:
            solution = opti.solve()
        except RuntimeError:  # Opti's way of reporting a solver status
            return failed_plan(PlanStatus.INFEASIBLE, self._config.controller.horizon, self._size)
        u, states = np.asarray(solution.value(self._u)), np.asarray(solution.value(self._x)).T
        return Plan(PlanStatus.SOLVED, u[0], u[1], float(solution.value(opti.f)), 0, states)

    def _build(self) -> None:
        config, bounds = self._config.controller, self._config.limits
        horizon, period_s = config.horizon, config.period_ms * 1e-3
        opti = self._opti = ca.Opti()
        x, u = opti.variable(self._size, horizon + 1), opti.variable(2, horizon)
        self._x, self._u = x, u
        self._start, self._desired = opti.parameter(self._size), opti.parameter(self._size)
        self._bounds = opti.parameter(3)
        points, camera = self._config.leds.points, self._config.camera.mount
        low, high = visibility_bounds(self._config.camera.pinhole, config.visibility_margin_px, len(points))
        weight = np.append(np.full(self._size - 1, config.terminal_weight), config.terminal_weight_theta)
        error = x[:, horizon] - self._desired
        cost: Any = ca.dot(weight, error**2)
        opti.subject_to(x[:, 0] == self._start)
        for k in range(horizon):
            rate = _rate(x[:, k], u[:, k], camera[2] - points[:, 2], camera)
            opti.subject_to(x[:, k + 1] == x[:, k] + period_s * rate)
            opti.subject_to(opti.bounded(self._bounds[0], u[0, k], self._bounds[1]))
            opti.subject_to(opti.bounded(-self._bounds[2], u[1, k], self._bounds[2]))
            opti.subject_to(opti.bounded(low, x[:-1, k + 1], high))
            if k:
                step = [bounds.controller_dv_m_s, bounds.controller_dw_rad_s]
                opti.subject_to(opti.bounded([-step[0], -step[1]], u[:, k] - u[:, k - 1], step))
            cost += config.effort_weight[0] * u[0, k] ** 2 + config.effort_weight[1] * u[1, k] ** 2
        opti.minimize(cost)
        limits = {"max_wall_time": MOST_S}  # seen by IPOPT between two iterations
        opti.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes", **limits})


def _rate(x: ca.MX, u: ca.MX, heights: Array, camera: Array) -> ca.MX:
    """J_x u: eq. (10), the interaction matrix."""
    rows = []
    for i, height in enumerate(heights):
        alpha, beta = x[2 * i], x[2 * i + 1]
        rows.append(
            alpha * beta / height * u[0] + (1 + alpha**2 + beta * (camera[0] - alpha * camera[1]) / height) * u[1]
        )
        rows.append(beta**2 / height * u[0] + (alpha * beta - beta**2 * camera[1] / height) * u[1])
    return ca.vertcat(*rows, -u[1])
