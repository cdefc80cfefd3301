"""Acquire and search: all well and the array in view before anything is armed; turn in place to find it."""

from __future__ import annotations

import math

from common.timing import NS_PER_S, HeldFor
from follower.supervisor.attempt import MAX_SEARCHES, Attempt, not_enabled
from follower.supervisor.interface import PhaseOutputs, PhaseResult, SupervisorInputs, turning
from follower.supervisor.phases.phase import PhaseLogic, failed

_CONFIRM_NS = NS_PER_S // 2
_THERE_RAD, _SLOWEST_RAD_S = 0.02, 0.05
# states with these causes come without an image: turning would not help
_NO_IMAGE = frozenset({"no_frame", "stale_frame", "bad_frame", "frozen_camera", "not_following"})


def search_refusal(attempt: Attempt, inputs: SupervisorInputs) -> str:
    """Why no search may begin, as a cause; empty if one may.

    Turning with a trolley in the grippers sweeps its front sideways: not near the queue.
    """
    if inputs.state is None:
        return "estimator_silent"
    if inputs.state.cause in _NO_IMAGE:
        return f"camera_silent: {inputs.state.cause}"
    lost = "leds_lost" if inputs.leader is not None else "leader_lost"
    if inputs.state.cause == "wrong_array":
        lost = "wrong_array"
    if attempt.searches >= MAX_SEARCHES:
        return f"{lost}: {attempt.searches} searches"
    to_goal_m = attempt.to_goal_m()
    if to_goal_m is not None and to_goal_m < attempt.config.supervisor.search_clearance_m:
        return f"{lost}: too close for a search"
    return ""


class AcquirePhase(PhaseLogic):
    """Waits until all conditions have held for 0.5 s, then arms; ends once the drives have followed."""

    def __init__(self, attempt: Attempt, now_ns: int) -> None:
        super().__init__(attempt, now_ns)
        self._well = HeldFor(_CONFIRM_NS)
        self._blind = HeldFor(round(self.limits.lost_timeout_s * NS_PER_S))
        self._lacked = ""

    def step(self, inputs: SupervisorInputs) -> PhaseOutputs | PhaseResult:
        """See :class:`PhaseLogic`."""
        attempt = self.attempt
        missing = self._missing(inputs)
        self._lacked = missing or self._lacked
        if self._well.step(inputs.now_ns, not missing):
            attempt.armed = True
            if attempt.obeyed(inputs.drives):
                return PhaseResult("armed")
        reading = inputs.state is not None and inputs.state.cause == "confirming"  # its code takes two seconds
        only_blind = bool(missing) and missing == attempt.blind(inputs) and not reading
        lost = self._blind.step(inputs.now_ns, only_blind)
        refusal = search_refusal(attempt, inputs) if only_blind else ""
        if lost and not refusal:
            return PhaseResult("leds_lost")
        if self.elapsed_s(inputs) > self.limits.acquire_timeout_s:
            named = refusal if inputs.state is not None else ""
            what = missing or (not_enabled(inputs.drives) if attempt.armed else self._lacked)
            return failed(named or f"acquire_timeout: {what}")
        return PhaseOutputs(waiting=missing or "drives")

    def _missing(self, inputs: SupervisorInputs) -> str:
        """The condition for arming that does not hold; empty if all hold. What turning could mend comes last."""
        attempt = self.attempt
        unwell = attempt.unwell(inputs)
        if unwell:
            return unwell
        if inputs.arms is None or not inputs.arms.gripped:
            return "no trolley in the grippers"
        return attempt.rolling() or attempt.leader_unready(inputs) or attempt.blind(inputs)


class SearchPhase(PhaseLogic):
    """Turns in place to the left, to the right and back, as often as searches remain.

    Ends as soon as the estimate has agreed with odometry for 0.5 s. Arms first if nothing was armed yet.
    """

    def __init__(self, attempt: Attempt, now_ns: int) -> None:
        super().__init__(attempt, now_ns)
        self._turn_rad = math.radians(self.limits.search_turn_deg)
        self._leg_limit_s = 2.0 * (2.0 * self._turn_rad / self.limits.search_rate_rad_s) + 5.0
        self._targets: list[float] = []
        self._leg_ns = now_ns
        self._heading_rad: float | None = None
        self._found, self._well = HeldFor(_CONFIRM_NS), HeldFor(_CONFIRM_NS)
        self._unwell = HeldFor(round(self.limits.lost_timeout_s * NS_PER_S), strictly=True)

    def step(self, inputs: SupervisorInputs) -> PhaseOutputs | PhaseResult:
        """See :class:`PhaseLogic`."""
        attempt, state = self.attempt, inputs.state
        if cause := attempt.untrusted(inputs):
            return failed(cause)
        found = state is not None and not attempt.blind(inputs) and attempt.reckoning.agrees(state)
        if self._found.step(inputs.now_ns, found):
            return PhaseResult("leds_found")
        unwell = attempt.unwell(inputs) or ("no docking state" if state is None else "")
        if not attempt.armed:
            unwell = unwell or attempt.rolling() or attempt.leader_unready(inputs)
        if self._unwell.step(inputs.now_ns, bool(unwell)):
            return failed("estimator_silent" if state is None else f"unwell: {unwell}")
        if self._well.step(inputs.now_ns, not unwell):
            attempt.armed = True
        if (inputs.now_ns - self._leg_ns) > self._leg_limit_s * NS_PER_S:
            still = "the turn was not completed" if attempt.enabled else not_enabled(inputs.drives)
            return failed(f"search_timeout: {unwell or still}")
        reading = state is not None and state.cause == "confirming"
        if found or reading or unwell or inputs.drives is None or not attempt.obeyed(inputs.drives):
            return PhaseOutputs(waiting=unwell or "LEDs")
        return self._turn(inputs, attempt.heading_rad(inputs.drives))

    def _turn(self, inputs: SupervisorInputs, heading_rad: float) -> PhaseOutputs | PhaseResult:
        if self._heading_rad is None:
            self._heading_rad = heading_rad
        if not self._targets:
            refusal = search_refusal(self.attempt, inputs)
            if refusal:
                return failed(refusal)
            self.attempt.searches += 1
            self._targets = [self._turn_rad, -self._turn_rad, 0.0]
        left_rad = self._targets[0] - (heading_rad - self._heading_rad)
        if abs(left_rad) < _THERE_RAD:
            self._targets.pop(0)
            self._leg_ns = inputs.now_ns
            return PhaseOutputs(waiting="LEDs")
        rate = min(self.limits.search_rate_rad_s, abs(left_rad))
        return turning(math.copysign(max(rate, _SLOWEST_RAD_S), left_rad))
