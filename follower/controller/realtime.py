"""The default controller: the paper's problem in 3 states, by one Gauss–Newton step a period.

The state is the relative pose; the features are its outputs, and the terminal cost of eq. (28) stays on
them. The motion is condensed into the inputs, which are linear between knots: velocity bounds and rate limit hold at
every step if they hold at the knots. What is left is a dense quadratic program of two variables a knot,
solved by daqp, with soft rows for features that come near the edge of the image.
"""

from __future__ import annotations

import math
from dataclasses import astuple

import daqp
import numpy as np

from common.config import Config, ControllerConfig, DockingConfig, LimitsConfig
from common.geometry import Array, Pinhole, Pose2, features_at
from follower.controller.drift import DriftStop, as_planned
from follower.controller.interface import Goal, MotionState, Plan, PlanStatus, SpeedCaps, Velocity, failed_plan
from follower.controller.knots import KnotBasis
from follower.controller.limits import possible_request, reachable_bounds, visibility_bounds
from follower.controller.optimality import quadratic_residual
from follower.controller.rollout import Rollout, roll_out
from follower.controller.wheel_lag import wheel_response
from follower.model.array import LedArray, led_by_led
from follower.model.motion import NO_DISTURBANCE, MotionDisturbance, drifts

COLD_STEPS = 5  # without a warm start; closed loop does the rest
CONVERGED = 1e-5
TOLERANCE = 1e-6
OPTIMALITY = 1e-6  # of the KKT residual, relative to the gradient; daqp ends near 1e-14
MOST_GIVEN = 1e3  # metres, metres a second, normalised: what is larger, or not a number, is no state of this robot
MOST_ITERATIONS = 500  # of daqp; a problem takes tens
NEAR_EDGE = 0.2  # normalised; features farther inside get no row
_SOFT = 8  # daqp's flag of a constraint that may be violated at a cost
_STATUSES = {-1: PlanStatus.INFEASIBLE, -4: PlanStatus.ITERATION_LIMIT}


class RealtimeController:
    """Gauss–Newton predictive control; keeps the last solution to linearise around."""

    def __init__(
        self,
        points_l: Array,
        camera_xyz_m: Array,
        pinhole: Pinhole,
        controller: ControllerConfig,
        limits: LimitsConfig,
        docking: DockingConfig,
        cold_steps: int = COLD_STEPS,
    ) -> None:
        config = controller.realtime
        self._stop = DriftStop(
            np.append(
                np.full(2 * len(points_l), docking.feature_tolerance), math.radians(docking.heading_tolerance_deg)
            )
        )
        self._cold_steps = cold_steps
        self._points_l, self._camera = points_l, camera_xyz_m
        self._array = LedArray(points_l, camera_xyz_m)
        dv, dw = config.rate_limit
        self._limits = limits.model_copy(
            update={
                "v_max_m_s": min(limits.v_max_m_s, config.cruise_m_s),
                "controller_dv_m_s": min(limits.controller_dv_m_s, dv),
                "controller_dw_rad_s": min(limits.controller_dw_rad_s, dw),
            }
        )
        self._step_limits = self._limits.controller_dv_m_s, self._limits.controller_dw_rad_s
        self._period_s = controller.period_ms * 1e-3
        self._knots = KnotBasis(config.knots)
        self._size = len(config.knots)
        lagged, self._lag_free = wheel_response(config.horizon, self._period_s, config.wheel_lag_ms * 1e-3)
        self._wheel_basis = lagged @ self._knots.basis
        self._visible = visibility_bounds(pinhole, controller.visibility_margin_px, len(points_l))
        alpha, beta, theta = config.terminal_weight
        self._terminal_weight = np.append(np.tile([alpha, beta], len(points_l)), theta)
        self._hessian = self._knots.hessian(config.effort_weight, config.rate_weight)
        self._effort_weight, self._rate_weight = config.effort_weight, config.rate_weight
        rates = self._knots.rates()
        self._rate_rows = np.block([[rates, 0 * rates], [0 * rates, rates]])
        self._rate_bounds = np.concatenate([self._knots.lengths * step for step in self._step_limits])
        self._watched = np.append(self._knots.knots[3:], config.horizon)
        self._soft = 1.0 / config.visibility_weight
        self._warm: Array | None = None

    def warm_up(self) -> None:
        """Solve from three metres before the goal, cold and then warm."""
        caps = SpeedCaps(
            v_min_m_s=self._limits.v_min_m_s, v_max_m_s=self._limits.v_max_m_s, w_max_rad_s=self._limits.w_max_rad_s
        )
        goal = Goal(features_at(self._points_l, Pose2(1.5, 0.0, 0.0), self._camera))
        start = MotionState(Pose2(4.5, 0.3, 0.1))
        for _ in range(3):
            self.solve(start, goal, (0.0, 0.0), caps)
        self.reset()

    def reset(self) -> None:
        """Forget the last solution."""
        self._warm = None
        self._stop.reset()

    def solve(self, state: MotionState, goal: Goal, last_applied: Velocity, caps: SpeedCaps) -> Plan:
        """One step from the last solution, several from none; see :class:`PredictiveController`.

        Args:
            state: pose when the command takes effect, disturbance, wheels.
            goal: where the plan leads.
            last_applied: command that u_0 may differ from by one step of the rate limit.
            caps: velocity bounds now.
        """
        pose, disturbance, wheels = state.leader_in_follower, state.disturbance, state.wheels
        desired = goal.outputs()
        horizon = self._knots.basis.shape[0]
        given = np.array([*pose.as_array(), *(wheels or ()), *astuple(disturbance), *desired])
        sound = desired.size == self._terminal_weight.size and bool(np.all(np.abs(given) <= MOST_GIVEN))
        if not sound or not possible_request(caps, last_applied, self._limits):
            return failed_plan(PlanStatus.INVALID_INPUT, horizon, 3)
        if self._arrived(pose, desired, disturbance):
            return self._stand(pose, desired, last_applied)
        return self._improve(pose, desired, last_applied, caps, disturbance, wheels or last_applied)

    def _arrived(self, pose: Pose2, desired: Array, disturbance: MotionDisturbance) -> bool:
        if not drifts(disturbance):
            self._stop.reset()
            return False
        try:
            error = self._outputs(pose) - desired
        except ValueError:  # the goal lies behind
            error = np.full(desired.size, np.inf)
        return self._stop.update(error)

    def _stand(self, pose: Pose2, desired: Array, last_applied: Velocity) -> Plan:
        """The plan that brakes and stays; the next one starts from it."""
        self._warm = knots = self._knots.braking(last_applied, self._step_limits)
        v, w = knots.reshape(2, -1) @ self._knots.basis.T
        rolled = roll_out(pose, v, w, self._period_s, NO_DISTURBANCE)
        return self._plan(rolled, knots, desired, last_applied, 0)

    def _improve(
        self,
        pose: Pose2,
        desired: Array,
        last_applied: Velocity,
        caps: SpeedCaps,
        observed: MotionDisturbance,
        wheels: Velocity,
    ) -> Plan:
        """Gauss–Newton steps from the last solution, or from none."""
        horizon = self._knots.basis.shape[0]
        knots, steps = self._guess(last_applied)
        free = np.outer(wheels, self._lag_free)
        disturbance = as_planned(observed, wheels[0])
        lower, upper = self._bounds(caps, last_applied)
        iterations = 0
        for _ in range(steps):
            rolled = self._roll_out(pose, knots, free, disturbance)
            try:
                status, solution, used = self._step(rolled, knots, desired, last_applied, lower, upper)
            except ValueError:  # the linearisation point leads behind the array
                status, solution, used = PlanStatus.NUMERICAL_FAILURE, knots, 0
            iterations += used
            if status is not PlanStatus.SOLVED:
                self._warm = None
                return failed_plan(status, horizon, 3, iterations)
            change = float(np.abs(solution - knots).max())
            knots = solution
            if change < CONVERGED:
                break
        self._warm = knots
        rolled = self._roll_out(pose, knots, free, disturbance)
        return self._plan(rolled, knots, desired, last_applied, iterations)

    def _guess(self, last_applied: Velocity) -> tuple[Array, int]:
        if self._warm is None:
            return self._knots.braking(last_applied, self._step_limits), self._cold_steps
        return (self._knots.shift @ self._warm.reshape(2, -1).T).T.reshape(-1), 1

    def _roll_out(self, pose: Pose2, knots: Array, free: Array, disturbance: MotionDisturbance) -> Rollout:
        v, w = knots.reshape(2, -1) @ self._wheel_basis.T + free
        return roll_out(pose, v, w, self._period_s, disturbance)

    def _step(
        self,
        rolled: Rollout,
        knots: Array,
        desired: Array,
        last_applied: Velocity,
        lower: Array,
        upper: Array,
    ) -> tuple[PlanStatus, Array, int]:
        """Solve the quadratic program linearised along ``rolled``."""
        horizon = self._knots.basis.shape[0]
        final = rolled.pose(horizon)
        outputs = self._outputs(final)
        _, slopes, _ = self._array.project(final.as_array()[None])
        by_pose = np.vstack([led_by_led(slopes[0]), [0.0, 0.0, 1.0]])
        by_knots = by_pose @ self._by_knots(rolled, horizon)
        weighted = by_knots.T * self._terminal_weight
        hessian = self._hessian + 2 * weighted @ by_knots
        gradient = 2 * weighted @ (outputs - desired - by_knots @ knots)
        gradient[0] -= 2 * self._rate_weight[0] * last_applied[0]
        gradient[self._size] -= 2 * self._rate_weight[1] * last_applied[1]
        rows, row_lower, row_upper = self._visibility_rows(rolled, knots)
        matrix = np.vstack([self._rate_rows, rows])
        high = np.concatenate([upper, self._rate_bounds, row_upper])
        low = np.concatenate([lower, -self._rate_bounds, row_lower])
        soft = np.repeat(np.array([0, _SOFT], np.int32), [lower.size + self._rate_bounds.size, len(rows)])
        if not (np.isfinite(hessian).all() and np.isfinite(gradient).all() and np.isfinite(matrix).all()):
            return PlanStatus.NUMERICAL_FAILURE, knots, 0
        solution, _, flag, info = daqp.solve(
            hessian, gradient, matrix, high, low, soft, rho_soft=self._soft, iter_limit=MOST_ITERATIONS
        )
        status = self._checked(flag, solution, lower, upper)
        if status is PlanStatus.SOLVED:
            residual = quadratic_residual(hessian, gradient, matrix, (low, high), solution, info["lam"])
            status = status if residual <= OPTIMALITY else PlanStatus.NUMERICAL_FAILURE
        return status, solution, int(info["iterations"])

    def _checked(self, flag: int, solution: Array, lower: Array, upper: Array) -> PlanStatus:
        """Trust no flag: a solution counts only if it keeps the hard bounds."""
        if flag <= 0:
            return _STATUSES.get(flag, PlanStatus.NUMERICAL_FAILURE)
        rates = np.abs(self._rate_rows @ solution) - self._rate_bounds
        kept = (
            np.isfinite(solution).all()
            and np.all(solution >= lower - TOLERANCE)
            and np.all(solution <= upper + TOLERANCE)
            and rates.max() <= TOLERANCE
        )
        return PlanStatus.SOLVED if kept else PlanStatus.NUMERICAL_FAILURE

    def _outputs(self, pose: Pose2) -> Array:
        """[features, θ] seen from a pose, (2n+1,)."""
        return np.append(features_at(self._points_l, pose, self._camera).reshape(-1), pose.theta_rad)

    def _by_knots(self, rolled: Rollout, k: int) -> Array:
        """Derivative of the pose after k steps by the knots, (3, 2m)."""
        by_v, by_w = rolled.sensitivity(k)
        basis = self._wheel_basis[:k]
        return np.hstack([by_v @ basis, by_w @ basis])

    def _visibility_rows(self, rolled: Rollout, knots: Array) -> tuple[Array, Array, Array]:
        """Rows for features that come near an edge of the image at a knot."""
        low, high = self._visible
        stages = self._watched
        poses = rolled.poses()[stages]
        features, depth = self._array.features(poses)
        if np.any(depth <= 0):
            raise ValueError("a point behind the camera has no image")
        seen = features.swapaxes(1, 2).reshape(len(poses), -1)
        near = (seen < low + NEAR_EDGE) | (seen > high - NEAR_EDGE)
        rows, row_low, row_high = [np.empty((0, knots.size))], [np.empty(0)], [np.empty(0)]
        for i in np.flatnonzero(near.any(axis=1)):
            here = near[i]
            _, slopes, _ = self._array.project(poses[i : i + 1])
            by_knots = led_by_led(slopes[0])[here] @ self._by_knots(rolled, int(stages[i]))
            offset = by_knots @ knots - seen[i, here]
            rows.append(by_knots)
            row_low.append(low[here] + offset)
            row_high.append(high[here] + offset)
        return np.vstack(rows), np.concatenate(row_low), np.concatenate(row_high)

    def _bounds(self, caps: SpeedCaps, last_applied: Velocity) -> tuple[Array, Array]:
        """Bounds of the knots (2m,); the first knot keeps the rate limit against the last command."""
        reach = reachable_bounds(caps, last_applied, self._limits, self._knots.basis.shape[0])
        v_low, v_high, w_low, w_high = (bound[self._knots.knots] for bound in reach)
        lower, upper = np.concatenate([v_low, w_low]), np.concatenate([v_high, w_high])
        for i, last, step in zip((0, self._size), last_applied, self._step_limits, strict=True):
            lower[i], upper[i] = max(lower[i], last - step), min(upper[i], last + step)
        return lower, upper

    def _plan(self, rolled: Rollout, knots: Array, desired: Array, last_applied: Velocity, iterations: int) -> Plan:
        v, w = knots.reshape(2, -1) @ self._knots.basis.T
        states = rolled.poses()
        try:
            error = self._outputs(Pose2(*states[-1])) - desired
        except ValueError:  # the plan leads past the array
            self._warm = None
            return failed_plan(PlanStatus.NUMERICAL_FAILURE, v.size, 3, iterations)
        cost = float(self._terminal_weight @ error**2)
        for inputs, last, effort, rate in zip(
            (v, w), last_applied, self._effort_weight, self._rate_weight, strict=True
        ):
            cost += effort * float(inputs @ inputs) + rate * float(np.sum(np.diff(inputs, prepend=last) ** 2))
        return Plan(PlanStatus.SOLVED, v, w, cost, iterations, states)


def make(config: Config, cold_steps: int = COLD_STEPS) -> RealtimeController:
    """The controller of a configuration; ``cold_steps`` are taken at most without a warm start."""
    return RealtimeController(
        config.leds.points,
        config.camera.mount,
        config.camera.pinhole,
        config.controller,
        config.limits,
        config.docking,
        cold_steps,
    )
