"""Eq. (28), the predictive problem, stage by stage, in the order that fatrop's structure detection reads."""

from __future__ import annotations

import casadi as ca
import numpy as np

from common.config import ControllerConfig, LimitsConfig
from common.geometry import Array
from follower.paper.model import symbolic_euler_step

VISIBILITY_WEIGHT = 20.0  # cost of one focal length out of view, each stage; above every multiplier seen


class Transcription:
    """Variables, cost and constraints of the NLP.

    Stage k has the state ``z_k = [x_k, u_{k−1}]`` and the control ``[u_k, σ_k]``. Carrying u_{k−1} along makes the
    rate limit a constraint of one stage, and limits u_0 against the command applied last, which the paper leaves
    open. σ_k is how far the worst feature of stage k lies out of view: it costs so much that it is zero wherever
    the paper's hard constraint can be met, and leaves the problem a solution where it cannot.

    Parameters of the NLP are ``[x_init, u_applied, x*]``.
    """

    def __init__(
        self,
        controller: ControllerConfig,
        limits: LimitsConfig,
        height_difference_m: Array,
        camera_xyz_m: Array,
        visible: tuple[Array, Array],
    ) -> None:
        self._controller = controller
        self._heights = height_difference_m
        self._camera = camera_xyz_m
        self._visible = visible
        self._rate = np.array([limits.controller_dv_m_s, limits.controller_dw_rad_s])
        self.size = 2 * len(height_difference_m) + 1
        self.variables: list[ca.SX] = []
        self.constraints: list[ca.SX] = []
        self.lower: list[float] = []
        self.upper: list[float] = []
        self.equality: list[bool] = []
        self.cost = ca.SX(0)
        self.parameters = ca.SX.sym("p", 2 * self.size + 2)
        self._write()

    def lagrangian_slope(self) -> ca.Function:
        """∂/∂x of cost + λᵀ constraints, from (variables, parameters, λ)."""
        variables, constraints = ca.vertcat(*self.variables), ca.vertcat(*self.constraints)
        multipliers = ca.SX.sym("lambda", constraints.shape[0])
        slope = ca.gradient(self.cost + ca.dot(multipliers, constraints), variables)
        return ca.Function("lagrangian_slope", [variables, self.parameters, multipliers], [slope])

    def _write(self) -> None:
        size, horizon = self.size, self._controller.horizon
        period_s = self._controller.period_ms * 1e-3
        carried = self._symbol("z0", size + 2)
        for k in range(horizon):
            control, slack = self._symbol(f"u{k}", 2), self._symbol(f"s{k}", 1)
            state, previous = carried[:size], carried[size:]
            self._add_effort(control, slack)
            moved = symbolic_euler_step(state, control, period_s, self._heights, self._camera)
            following = ca.SX.sym(f"z{k + 1}", size + 2)
            self._constrain(following - ca.vertcat(moved, control), np.zeros(size + 2), np.zeros(size + 2))
            if k == 0:
                self._constrain(carried - self.parameters[: size + 2], np.zeros(size + 2), np.zeros(size + 2))
            else:
                self._keep_visible(state, slack)
            self._constrain(control - previous, -self._rate, self._rate)
            self.variables.append(following)
            carried = following
        slack = self._symbol(f"s{horizon}", 1)
        self._keep_visible(carried[:size], slack)
        self._add_terminal(carried[:size], slack)

    def _add_effort(self, control: ca.SX, slack: ca.SX) -> None:
        r_v, r_w = self._controller.effort_weight
        self.cost += r_v * control[0] ** 2 + r_w * control[1] ** 2 + self._slack_cost(slack)

    def _add_terminal(self, state: ca.SX, slack: ca.SX) -> None:
        weights = np.full(self.size, self._controller.terminal_weight)
        weights[-1] = self._controller.terminal_weight_theta
        error = state - self.parameters[self.size + 2 :]
        self.cost += ca.dot(weights, error**2) + self._slack_cost(slack)

    @staticmethod
    def _slack_cost(slack: ca.SX) -> ca.SX:
        return VISIBILITY_WEIGHT * (slack + slack**2)

    def _keep_visible(self, state: ca.SX, slack: ca.SX) -> None:
        low, high = self._visible
        features = state[:-1]
        unbounded = np.full(low.size, np.inf)
        self._constrain(features + slack, low, unbounded)
        self._constrain(features - slack, -unbounded, high)

    def _symbol(self, name: str, size: int) -> ca.SX:
        symbol = ca.SX.sym(name, size)
        self.variables.append(symbol)
        return symbol

    def _constrain(self, expression: ca.SX, lower: Array, upper: Array) -> None:
        self.constraints.append(expression)
        self.lower.extend(lower)
        self.upper.extend(upper)
        self.equality.extend((lower == upper).tolist())
