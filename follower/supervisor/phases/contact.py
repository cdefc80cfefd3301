"""Insert and push: straight ahead until joint torques show guide or queue, then until the connection is rigid."""

from __future__ import annotations

import math
from dataclasses import replace

from common.docking_errors import docked_error
from common.geometry import Pose2
from common.messages import DockingState, Drives
from common.timing import NS_PER_S, HeldFor
from follower.supervisor.attempt import Attempt
from follower.supervisor.interface import PhaseOutputs, PhaseResult, SupervisorInputs, straight
from follower.supervisor.phases.phase import PhaseLogic, failed

_STROKE_SHARE = 0.8
_SHORT_M = 0.015  # a good push ends up to 4 cm beyond its stroke as the play of the queue closes, never short of it
_SPARE_S = 3.0


class _Ahead(PhaseLogic):
    """Common to both: distance since the insertion began, its limit, and a pause without the LEDs."""

    def __init__(self, attempt: Attempt, now_ns: int) -> None:
        super().__init__(attempt, now_ns)
        self._lost = HeldFor(round(self.limits.lost_timeout_s * NS_PER_S), strictly=True)
        self._before_ns = now_ns
        self._driven_s = 0.0

    def _pushed_m(self, drives: Drives) -> float:
        attempt = self.attempt
        odometer_m = attempt.odometer_m(drives)
        if attempt.contact_begin_m is None:
            attempt.contact_begin_m = odometer_m
        return odometer_m - attempt.contact_begin_m

    def _ahead(self, inputs: SupervisorInputs, pushed_m: float, speed_m_s: float) -> PhaseOutputs | PhaseResult:
        """Go on, or stand without LEDs: in contact nothing is released and nothing is searched for."""
        if pushed_m > self.limits.push_limit_m:
            return failed("no_contact")
        if cause := self.attempt.untrusted(inputs):
            return failed(cause)
        elapsed_s, self._before_ns = (inputs.now_ns - self._before_ns) * 1e-9, inputs.now_ns
        unwell = self.attempt.unwell(inputs) or self.attempt.blind(inputs)
        if self._lost.step(inputs.now_ns, bool(unwell)):
            return failed(self._lost_cause(inputs, unwell))
        if unwell:
            return PhaseOutputs(contact_expected=True, waiting=unwell)
        self._driven_s += elapsed_s
        if self._driven_s > 2.0 * self.limits.push_limit_m / speed_m_s + _SPARE_S:
            return failed("push_timeout")
        return straight(speed_m_s, contact_expected=True)

    def _lost_cause(self, inputs: SupervisorInputs, unwell: str) -> str:
        if unwell != self.attempt.blind(inputs):
            return f"unwell: {unwell}"
        if inputs.state is None:
            return "estimator_silent"
        if self.attempt.trust.doubted:
            return f"not_following: {unwell}"
        return f"{'leds_lost' if inputs.leader is not None else 'leader_lost'}: in contact"


class InsertPhase(_Ahead):
    """From the goal to the first resistance."""

    def step(self, inputs: SupervisorInputs) -> PhaseOutputs | PhaseResult:
        """See :class:`PhaseLogic`."""
        if inputs.drives is None:
            return PhaseOutputs(contact_expected=True, waiting="drives")
        pushed_m = self._pushed_m(inputs.drives)
        if inputs.arms is not None and (inputs.arms.contact or inputs.arms.connected):
            return PhaseResult("contact")
        return self._ahead(inputs, pushed_m, self.limits.insert_speed_m_s)


class PushPhase(_Ahead):
    """Until all trolleys are rigidly connected: by torque, by the distance pushed, and by the camera."""

    def step(self, inputs: SupervisorInputs) -> PhaseOutputs | PhaseResult:
        """See :class:`PhaseLogic`."""
        if inputs.drives is None:
            return PhaseOutputs(contact_expected=True, waiting="drives")
        pushed_m = self._pushed_m(inputs.drives)
        if inputs.arms is not None and inputs.arms.connected:
            return self._connected(inputs, pushed_m)
        return self._ahead(inputs, pushed_m, self.limits.push_speed_m_s)

    def _connected(self, inputs: SupervisorInputs, pushed_m: float) -> PhaseOutputs | PhaseResult:
        stroke_m = self.attempt.config.docking.push_stroke_m
        if pushed_m < _STROKE_SHARE * stroke_m:
            return failed("contact_early")
        state = inputs.state
        if state is None or not state.valid:
            if self._lost.step(inputs.now_ns, True):
                return failed(self._lost_cause(inputs, self.attempt.blind(inputs)))
            return PhaseOutputs(contact_expected=True, waiting="LEDs")
        if self._visual_error_m(state, pushed_m) > self.limits.push_visual_tolerance_m:
            return failed("contact_elsewhere")
        return PhaseResult("connected")

    def _visual_error_m(self, state: DockingState, pushed_m: float) -> float:
        """Error of the end of the push by the LEDs: along, and beyond the bound across; infinite if short.

        Along against odometry, which slips, and against the whole stroke: a trolley blocked before its place is rigid
        too, and no switch shows it for a later one.
        """
        docking, goal = self.attempt.config.docking, self.attempt.goal
        at = Pose2(state.x_m, state.y_m, state.theta_rad).inverse()
        by_stroke = docked_error(at, replace(goal, x_m=goal.x_m - docking.push_stroke_m))
        by_wheels = docked_error(at, replace(goal, x_m=goal.x_m - pushed_m))
        bound_m = docking.lateral_bound_first_m if self.attempt.trolley == 1 else docking.lateral_bound_next_m
        if by_stroke.e_x_m > _SHORT_M:
            return math.inf
        return max(abs(by_wheels.e_x_m), abs(by_wheels.e_y_m) - bound_m)
