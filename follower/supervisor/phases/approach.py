"""Approach: servo to the goal; pause without the LEDs and resume in place; settle."""

from __future__ import annotations

import math
from dataclasses import replace

from common.geometry import Array
from common.kinematics import twist_from_wheels
from common.messages import DockingState
from common.timing import NS_PER_S, HeldFor
from follower.supervisor.attempt import MAX_PAUSES, MAX_RETRIES, Attempt
from follower.supervisor.image_trust import NOT_FOLLOWING
from follower.supervisor.interface import PhaseOutputs, PhaseResult, SupervisorInputs, turning
from follower.supervisor.lateral_forecast import LateralForecast
from follower.supervisor.phases.acquire import search_refusal
from follower.supervisor.phases.phase import PhaseLogic, failed

LAST_METRE_M = 1.0
_SLOWING_M_S2 = (
    0.15  # towards the last metre: gentle enough for the controller to follow, so that the gate has nothing to clip
)
_RESUME_NS = NS_PER_S // 2
_HEALTHY_NS = 2 * NS_PER_S
_MISSING_LED_NS = 3 * NS_PER_S // 10
_NEARER_M = 0.02
_HEADING_LEVER_M = 0.5
_OVERSHOT_M = 0.15
# how fast it turns to see whether the image lives
_PROOF_RAD_S = 0.1
# a speed error that no load explains, as a share of the largest that the estimator may find; for how long; after the
# first time for how long, while the estimator learns that the slip is over; above which speed
_SLIP_SHARE, _SLIP_NS, _SLIP_AGAIN_NS, _SLIP_SPEED_M_S = 0.6, 3 * NS_PER_S // 10, NS_PER_S, 0.05


class WheelSlip:
    """Detects wheels that turn while the robot, by its estimate, hardly moves (``docs/safety.md`` S40)."""

    def __init__(self, attempt: Attempt) -> None:
        self._attempt = attempt
        self._gain = -_SLIP_SHARE * attempt.config.estimator.disturbance.bound[0]
        self._first, self._again = HeldFor(_SLIP_NS), HeldFor(_SLIP_AGAIN_NS)
        self._found_once = False

    def step(self, inputs: SupervisorInputs) -> bool:
        """Take one step; true once slip has lasted 0.3 s, later 1 s."""
        state, drives = inputs.state, inputs.drives
        slips = False
        if state is not None and state.valid and drives is not None:
            v_m_s, _ = twist_from_wheels(self._attempt.config.base, drives.wheel_speed_rad_s)
            slips = abs(v_m_s) > _SLIP_SPEED_M_S and state.disturbance[0] < self._gain
        first, again = self._first.step(inputs.now_ns, slips), self._again.step(inputs.now_ns, slips)
        found = again if self._found_once else first
        self._found_once = self._found_once or found
        return found


class Pause:
    """S0: zero speed, still armed, from the first unhealthy step until all has been healthy for 0.5 s.

    Healthy includes that the array is in view and agrees with odometry.
    """

    def __init__(self, attempt: Attempt) -> None:
        self._attempt = attempt
        self._well = HeldFor(_RESUME_NS)
        self._unwell = HeldFor(round(attempt.config.supervisor.lost_timeout_s * NS_PER_S), strictly=True)
        self._slip = WheelSlip(attempt)
        self.on = False
        self.code = self.reason = ""

    @property
    def too_long(self) -> bool:
        """Whether it has been unhealthy for longer than ``supervisor.lost_timeout_s``."""
        return self._unwell.on

    def step(self, inputs: SupervisorInputs, too_uncertain: bool) -> None:
        """Take one step; ``too_uncertain``: the remaining LEDs do not locate the goal well enough."""
        attempt = self._attempt
        self.code, self.reason = "unwell", attempt.blind(inputs) or attempt.unwell(inputs)
        if not self.reason and too_uncertain:
            self.code, self.reason = "few_leds", "too few LEDs to locate the goal"
        if self._slip.step(inputs) and not self.reason:
            self.code, self.reason = "unwell", NOT_FOLLOWING
        if not self.reason and inputs.state is not None and not attempt.reckoning.agrees(inputs.state):
            self.code, self.reason = "lock_disagrees", "the LEDs are not where odometry expects them"
        self._unwell.step(inputs.now_ns, bool(self.reason))
        well = self._well.step(inputs.now_ns, not self.reason)
        if self.reason and not self.on:
            self.on = True
            attempt.pauses += 1
        elif self.on and well:
            self.on = False


class ApproachPhase(PhaseLogic):
    """Ends when arrived and settled, when the LEDs stay lost, or when it comes no nearer."""

    def __init__(self, attempt: Attempt, now_ns: int) -> None:
        super().__init__(attempt, now_ns)
        self._pause = Pause(attempt)
        self._settled = HeldFor(round(attempt.config.docking.settle_s * NS_PER_S))
        self._healthy = HeldFor(_HEALTHY_NS)
        self._forecast = LateralForecast(attempt.config, attempt.goal)
        self._last_seen_ns: list[int] = [now_ns] * len(attempt.desired)
        self._nearest_m = math.inf
        self._nearest_s = 0.0
        self._driven_s = self._allowed_s = self._proof_rad_s = 0.0
        self._before_ns = now_ns

    def step(self, inputs: SupervisorInputs) -> PhaseOutputs | PhaseResult:
        """See :class:`PhaseLogic`."""
        if inputs.arms is not None and inputs.arms.connected:
            return failed("contact_early")
        if cause := self.attempt.untrusted(inputs):
            return failed(cause)
        missing = self._missing_leds(inputs)
        self._pause.step(inputs, bool(missing) and self._forecast.sigma_m(missing) > self.limits.reduced_sigma_m)
        self._healthy.step(inputs.now_ns, not self._pause.reason)
        elapsed_s = (inputs.now_ns - self._before_ns) * 1e-9
        self._before_ns = inputs.now_ns
        if self._pause.on:
            return self._paused(inputs)
        self._driven_s += elapsed_s
        # slowed down for a missing LED it may take proportionally longer
        self._allowed_s += elapsed_s * (
            self.limits.reduced_speed_m_s / self.limits.approach_speed_m_s if missing else 1.0
        )
        state = inputs.state
        assert state is not None  # or it would pause
        if self._settled.step(inputs.now_ns, arrived(self.attempt, state)):
            return PhaseResult("arrived")
        return self._unreachable(state, inputs) or self._servo(state, bool(missing))

    def _paused(self, inputs: SupervisorInputs) -> PhaseOutputs | PhaseResult:
        pause = self._pause
        self._settled.reset()
        if self.attempt.pauses > MAX_PAUSES:
            return failed(f"too_many_pauses: {pause.reason}")
        if pause.too_long:
            blind = self.attempt.blind(inputs)
            if not blind:
                return failed(f"{pause.code}: {pause.reason}")
            if self.attempt.trust.doubted:
                return failed(f"not_following: {blind}")
            refusal = search_refusal(self.attempt, inputs)
            return failed(refusal) if refusal else PhaseResult("leds_lost")
        state = inputs.state
        if self.attempt.trust.doubted and state is not None and state.valid and not self.attempt.unwell(inputs):
            if not self._proof_rad_s:
                # towards the Leader's axis: the trolley's front comes no nearer to what is beside the queue
                self._proof_rad_s = math.copysign(_PROOF_RAD_S, state.theta_rad - self.attempt.goal.theta_rad)
            return replace(turning(self._proof_rad_s), waiting=NOT_FOLLOWING)
        self._proof_rad_s = 0.0
        return PhaseOutputs(waiting=pause.reason or "health")

    def _servo(self, state: DockingState, reduced: bool) -> PhaseOutputs:
        limits = self.limits
        before_m = max(0.0, state.x_m - self.attempt.goal.x_m - LAST_METRE_M)
        v_max = min(
            limits.approach_speed_m_s, math.sqrt(limits.last_metre_speed_m_s**2 + 2 * _SLOWING_M_S2 * before_m)
        )
        if reduced:
            v_max = min(v_max, limits.reduced_speed_m_s)
        return PhaseOutputs(motion="servo", v_max_m_s=v_max, w_max_rad_s=self.attempt.config.limits.w_max_rad_s)

    def _missing_leds(self, inputs: SupervisorInputs) -> tuple[int, ...]:
        """LEDs that have not been seen for 0.3 s, while others are."""
        state = inputs.state
        if state is None or not state.valid or len(state.features) != len(self._last_seen_ns):
            return ()
        for led, feature in enumerate(state.features):
            if feature is not None:
                self._last_seen_ns[led] = inputs.now_ns
        latest_ns = max(self._last_seen_ns)
        return tuple(led for led, at in enumerate(self._last_seen_ns) if latest_ns - at > _MISSING_LED_NS)

    def _unreachable(self, state: DockingState, inputs: SupervisorInputs) -> PhaseResult | None:
        """No nearer for too long, beyond the goal, or too long under way: retry from the staging pose if allowed."""
        goal = self.attempt.goal
        off_m = math.hypot(state.x_m - goal.x_m, state.y_m) + _HEADING_LEVER_M * abs(state.theta_rad)
        if off_m < self._nearest_m - _NEARER_M or arrived(self.attempt, state):
            self._nearest_m, self._nearest_s = min(off_m, self._nearest_m), self._driven_s
        limits = self.limits
        if state.x_m < goal.x_m - _OVERSHOT_M:
            cause = "overshot"
        elif self._driven_s - self._nearest_s > limits.stall_timeout_s:
            cause = "no_progress"
        elif self._allowed_s > limits.approach_timeout_s:
            cause = "approach_timeout"
        else:
            return None
        return self._again(cause, inputs)

    def _again(self, cause: str, inputs: SupervisorInputs) -> PhaseResult | None:
        attempt = self.attempt
        if attempt.retries >= MAX_RETRIES:
            return failed(f"{cause}: {attempt.retries} retries")
        touched = inputs.arms is None or inputs.arms.contact or inputs.arms.connected or not inputs.arms.gripped
        if touched or attempt.leader_unready(inputs):
            return failed(f"{cause}: no retry with something in contact or a lock engaged")
        if not self._healthy.on:
            return None  # unhealthy a moment ago: wait until it has been healthy for 2 s
        attempt.retries += 1
        attempt.retreating = True
        return PhaseResult("unreachable", cause)


def arrived(attempt: Attempt, state: DockingState) -> bool:
    """The stop test of Algorithm 1, on the filtered state, as noise would spoil it on the raw one."""
    if not state.features_filtered:
        return False
    docking = attempt.config.docking
    desired: Array = attempt.desired
    worst = max(
        max(abs(a - da), abs(b - db)) for (a, b), (da, db) in zip(state.features_filtered, desired, strict=True)
    )
    heading = abs(state.theta_rad - attempt.goal.theta_rad)
    return worst <= docking.feature_tolerance and heading <= math.radians(docking.heading_tolerance_deg)
