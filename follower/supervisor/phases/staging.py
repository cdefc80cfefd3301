"""Staging: back to the staging pose and grip the trolley brought there; or back with a trolley, to try again."""

from __future__ import annotations

from typing import Literal

from common.messages import Drives
from common.timing import NS_PER_S, HeldFor
from follower.supervisor.attempt import Attempt, not_enabled
from follower.supervisor.interface import PhaseOutputs, PhaseResult, SupervisorInputs, straight
from follower.supervisor.phases.phase import PhaseLogic, failed

StagingStep = Literal["check", "open", "back", "stand", "close"]
_STAND_S = 0.5
_HEALTHY_NS = 2 * NS_PER_S
_HELD_NS = NS_PER_S // 2
_CHECK_TIMEOUT_S = 5.0
_SLOWEST, _RAMP_S = 1.3, 2.0
_NEAR_M = 0.02


class StagingPhase(PhaseLogic):
    """``check`` → ``open`` the grippers → ``back`` by odometry → ``stand`` → ``close`` on the trolley.

    With a trolley in the grippers at the start it ends at once. The path back is straight and measured by odometry
    from the last valid state; already at or beyond the pose it stands where it is.
    """

    def __init__(self, attempt: Attempt, now_ns: int) -> None:
        super().__init__(attempt, now_ns)
        self._stage: StagingStep = "check"
        self._stage_ns = now_ns
        self._healthy, self._gripped = HeldFor(_HEALTHY_NS), HeldFor(_HELD_NS)
        stand_s = _STAND_S if attempt.retreating else max(_STAND_S, self.limits.trolley_wait_s)
        self._still = HeldFor(round(stand_s * NS_PER_S))
        self._back_m = 0.0
        self._back_from_m: float | None = None
        self._stood_ns: int | None = None

    def step(self, inputs: SupervisorInputs) -> PhaseOutputs | PhaseResult:
        """See :class:`PhaseLogic`."""
        if self._stage == "check":
            return self._check(inputs)
        drives = inputs.drives
        if drives is None or not self.attempt.obeyed(drives):
            # the sequence ends the docking if the drives stay silent; until then nothing moves
            return self._overdue(
                inputs, self.limits.acquire_timeout_s, f"staging_timeout: {not_enabled(inputs.drives)}"
            )
        if self._stage == "open":
            return self._open(inputs)
        if self._stage == "back":
            return self._back(inputs, drives)
        if self._stage == "stand":
            return self._stand(inputs)
        return self._close(inputs)

    def _check(self, inputs: SupervisorInputs) -> PhaseOutputs | PhaseResult:
        """Nothing is armed before all is well; a retry needs it well for 2 s, and the LEDs in view."""
        attempt = self.attempt
        gripped = inputs.arms is not None and inputs.arms.gripped
        if gripped and not attempt.retreating:
            attempt.grip = "closed"  # the docking before may have left it open
            return PhaseResult("gripped")
        lacking = attempt.unwell(inputs) or attempt.rolling() or attempt.leader_unready(inputs)
        if attempt.retreating:
            lacking = lacking or attempt.blind(inputs) or ("" if gripped else "trolley not gripped")
        to_goal_m = attempt.to_goal_m()
        if not lacking and to_goal_m is None:
            lacking = "the Leader has not been seen yet"
        healthy = self._healthy.step(inputs.now_ns, not lacking)
        if lacking or to_goal_m is None or (attempt.retreating and not healthy):
            wait = PhaseOutputs(waiting=lacking or "health")
            return failed(f"staging_timeout: {lacking}") if self.elapsed_s(inputs) > _CHECK_TIMEOUT_S else wait
        docking = attempt.config.docking
        self._back_m = docking.staging_distance_m - to_goal_m
        farthest_m = docking.staging_distance_m + docking.trolley_pitch_m + self.limits.push_limit_m
        if self._back_m > farthest_m:
            # nothing watches the path back: a wrong number must not send it across the hall
            far = f"{self._back_m:.1f} m back, more than {farthest_m:.1f} m: is {attempt.trolley} the right trolley?"
            return failed(f"staging_timeout: {far}")
        attempt.armed = True
        return self._enter("back" if attempt.retreating else "open", inputs)

    def _open(self, inputs: SupervisorInputs) -> PhaseOutputs | PhaseResult:
        self.attempt.grip = "open"
        if inputs.arms is not None and inputs.arms.released:
            return self._enter("back" if self._stood_ns is None else "stand", inputs)
        return self._overdue(inputs, self.limits.grip_timeout_s, "release_timeout", "grippers to open")

    def _back(self, inputs: SupervisorInputs, drives: Drives) -> PhaseOutputs | PhaseResult:
        odometer_m = self.attempt.odometer_m(drives)
        if self._back_from_m is None:
            self._back_from_m = odometer_m
        left_m = self._back_m - (self._back_from_m - odometer_m)
        if left_m <= _NEAR_M:
            return self._enter("stand", inputs)
        unfit = self.attempt.unfit(inputs)
        speed = self.limits.retract_speed_m_s
        if self._stage_s(inputs) > _SLOWEST * self._back_m / speed + _RAMP_S:
            return failed(f"staging_timeout: {unfit or 'the path back was not completed'}")
        return PhaseOutputs(waiting=unfit) if unfit else straight(-speed, waiting="staging pose")

    def _stand(self, inputs: SupervisorInputs) -> PhaseOutputs | PhaseResult:
        if self._stood_ns is None:
            self._stood_ns = inputs.now_ns
        stood = self._still.step(inputs.now_ns, self.attempt.standstill.holds)
        if self.attempt.retreating:
            if not stood:
                return PhaseOutputs(waiting="standstill")
            self.attempt.retreating = False
            return PhaseResult("gripped")
        if inputs.now_ns - self._stood_ns > self.limits.trolley_timeout_s * NS_PER_S:
            return failed("no_trolley")
        if stood:
            return self._enter("close", inputs)
        return PhaseOutputs(waiting="trolley")

    def _close(self, inputs: SupervisorInputs) -> PhaseOutputs | PhaseResult:
        self.attempt.grip = "closed"
        if self._gripped.step(inputs.now_ns, inputs.arms is not None and inputs.arms.gripped):
            return PhaseResult("gripped")
        if self._stage_s(inputs) > self.limits.grip_timeout_s:
            return self._enter("open", inputs)
        return PhaseOutputs(waiting="grip on the trolley")

    def _enter(self, stage: StagingStep, inputs: SupervisorInputs) -> PhaseOutputs:
        """The next stage, from the next step on; in this step it stands."""
        self._stage, self._stage_ns = stage, inputs.now_ns
        self._still.reset()
        self._gripped.reset()
        return PhaseOutputs(waiting="staging pose")

    def _stage_s(self, inputs: SupervisorInputs) -> float:
        return (inputs.now_ns - self._stage_ns) / NS_PER_S

    def _overdue(
        self, inputs: SupervisorInputs, limit_s: float, cause: str, waiting: str = "drives"
    ) -> PhaseOutputs | PhaseResult:
        return failed(cause) if self._stage_s(inputs) > limit_s else PhaseOutputs(waiting=waiting)
