"""Lock, release, retract: wait for the Leader's confirmation, release the trolley, back away."""

from __future__ import annotations

from typing import Literal

from common.messages import Answer, LockRequest
from common.timing import NS_PER_S
from follower.supervisor.attempt import Attempt
from follower.supervisor.interface import PhaseOutputs, PhaseResult, SupervisorInputs, straight
from follower.supervisor.phases.phase import PhaseLogic, failed

_REPEAT_NS = NS_PER_S
_SLOWEST, _RAMP_S = 1.3, 1.0


class LockPhase(PhaseLogic):
    """Asks the Leader to lock behind trolley 1, or whether the lock still holds behind a later one.

    The request is repeated under one id, so that it is carried out once. Without the link the Follower stands in
    contact, grippers closed, and reports that it waits; nothing is released without the Leader's confirmation. If
    none comes within ``link_timeout_s`` the docking ends as ``leader_silent``, still closed, until the operator has
    restored the link and resets.
    """

    def __init__(self, attempt: Attempt, now_ns: int) -> None:
        super().__init__(attempt, now_ns)
        self._action: Literal["lock", "confirm"] = "lock" if attempt.trolley == 1 else "confirm"
        self._id = f"{self._action}-{attempt.epoch}"
        self._asked_ns: int | None = None
        self._confirmed = False
        self._linked_s = 0.0
        self._before_ns = now_ns

    def step(self, inputs: SupervisorInputs) -> PhaseOutputs | PhaseResult:
        """See :class:`PhaseLogic`."""
        for answer in inputs.lock_answers:
            ended = self._take(answer)
            if ended is not None:
                return ended
        if inputs.leader is not None:
            self._linked_s += (inputs.now_ns - self._before_ns) / NS_PER_S
        self._before_ns = inputs.now_ns
        if self._confirmed and inputs.leader is not None and inputs.leader.lock == "locked":
            return PhaseResult("confirmed")
        if self._linked_s > self.limits.lock_timeout_s:
            return failed("lock_timeout")
        if self.elapsed_s(inputs) > self.limits.link_timeout_s:
            return failed("leader_silent")
        waiting = "the Leader's link" if inputs.leader is None else "the Leader's lock"
        return PhaseOutputs(contact_expected=True, waiting=waiting, lock_request=self._request(inputs.now_ns))

    def _take(self, answer: Answer) -> PhaseResult | None:
        if answer.id != self._id:
            return None
        if answer.outcome != "done":
            return failed(f"lock_{answer.outcome}: {answer.reason}")
        self._confirmed = True
        return None

    def _request(self, now_ns: int) -> LockRequest | None:
        if self._asked_ns is not None and now_ns - self._asked_ns < _REPEAT_NS:
            return None
        self._asked_ns = now_ns
        valid_ms = round(self.limits.lock_timeout_s * 1000)
        return LockRequest(id=self._id, valid_for_ms=valid_ms, action=self._action, trolley=self.attempt.trolley)


class ReleasePhase(PhaseLogic):
    """Opens the grippers: the trolley is locked."""

    def step(self, inputs: SupervisorInputs) -> PhaseOutputs | PhaseResult:
        """See :class:`PhaseLogic`."""
        self.attempt.grip = "open"
        if inputs.arms is not None and inputs.arms.released:
            return PhaseResult("released")
        if self.elapsed_s(inputs) > self.limits.grip_timeout_s:
            return failed("release_timeout")
        return PhaseOutputs(waiting="grippers to open")


class RetractPhase(PhaseLogic):
    """Straight back by odometry, clear of the trolley."""

    def __init__(self, attempt: Attempt, now_ns: int) -> None:
        super().__init__(attempt, now_ns)
        self._begin_m: float | None = None

    def step(self, inputs: SupervisorInputs) -> PhaseOutputs | PhaseResult:
        """See :class:`PhaseLogic`."""
        limits = self.limits
        # nothing looks backwards: what the wheels' angles miss, time bounds
        if self.elapsed_s(inputs) > _SLOWEST * limits.retract_distance_m / limits.retract_speed_m_s + _RAMP_S:
            unfit = self.attempt.unfit(inputs)
            return failed(f"retract_timeout: {unfit}" if unfit else "retract_timeout")
        if inputs.drives is None:
            return PhaseOutputs(waiting="drives")
        odometer_m = self.attempt.odometer_m(inputs.drives)
        if self._begin_m is None:
            self._begin_m = odometer_m
        if self._begin_m - odometer_m >= limits.retract_distance_m:
            return PhaseResult("clear")
        if unfit := self.attempt.unfit(inputs):
            return PhaseOutputs(waiting=unfit)
        return straight(-limits.retract_speed_m_s)
