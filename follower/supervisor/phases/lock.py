"""Lock, release, retract: the Leader's word, then let go and back away."""

from __future__ import annotations

from typing import Literal

from common.messages import Answer, LockRequest
from common.timing import NS_PER_S
from follower.supervisor.attempt import Attempt
from follower.supervisor.observed import Observed, Orders, Verdict, straight
from follower.supervisor.phases.phase import PhaseLogic, failed

_REPEAT_NS = NS_PER_S


class Lock(PhaseLogic):
    """Asks the Leader to lock behind trolley 1, or whether the lock still holds behind a later one.

    The request is repeated under one id, so that it is carried out once. Without the link the Follower stands in
    contact, grippers closed, and says that it waits; nothing is let go without the Leader's word. When the word does
    not come in ``link_timeout_s`` the docking ends as ``leader_silent``, still closed: a person looks, clears the
    link, and resets.
    """

    def __init__(self, attempt: Attempt, now_ns: int) -> None:
        super().__init__(attempt, now_ns)
        self._action: Literal["lock", "confirm"] = "lock" if attempt.trolley == 1 else "confirm"
        self._id = f"{self._action}-{attempt.epoch}"
        self._asked_ns: int | None = None
        self._confirmed = False
        self._heard_s = 0.0
        self._before_ns = now_ns

    def step(self, seen: Observed) -> Orders | Verdict:
        """See :class:`PhaseLogic`."""
        for answer in seen.lock_answers:
            ended = self._take(answer)
            if ended is not None:
                return ended
        if seen.leader is not None:
            self._heard_s += (seen.now_ns - self._before_ns) / NS_PER_S
        self._before_ns = seen.now_ns
        if self._confirmed and seen.leader is not None and seen.leader.lock == "locked":
            return Verdict("confirmed")
        if self._heard_s > self.limits.lock_timeout_s:
            return failed("lock_timeout")
        if self.elapsed_s(seen) > self.limits.link_timeout_s:
            return failed("leader_silent")
        waiting = "the Leader's link" if seen.leader is None else "the Leader's lock"
        return Orders(contact_expected=True, waiting=waiting, lock_request=self._request(seen.now_ns))

    def _take(self, answer: Answer) -> Verdict | None:
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
        return LockRequest(self._id, valid_ms, self._action, self.attempt.trolley)


class Release(PhaseLogic):
    """Opens the grippers: the trolley is locked."""

    def step(self, seen: Observed) -> Orders | Verdict:
        """See :class:`PhaseLogic`."""
        self.attempt.grip = "open"
        if seen.arms is not None and seen.arms.released:
            return Verdict("released")
        if self.elapsed_s(seen) > self.limits.grip_timeout_s:
            return failed("release_timeout")
        return Orders(waiting="grippers to open")


class Retract(PhaseLogic):
    """Straight back by odometry, clear of the trolley."""

    def __init__(self, attempt: Attempt, now_ns: int) -> None:
        super().__init__(attempt, now_ns)
        self._begin_m: float | None = None

    def step(self, seen: Observed) -> Orders | Verdict:
        """See :class:`PhaseLogic`."""
        limits = self.limits
        if self.elapsed_s(seen) > 3 * limits.retract_distance_m / limits.retract_speed_m_s:
            return failed("retract_timeout")
        if seen.drives is None:
            return Orders(waiting="drives")
        odometer_m = self.attempt.odometer_m(seen.drives)
        if self._begin_m is None:
            self._begin_m = odometer_m
        if self._begin_m - odometer_m >= limits.retract_distance_m:
            return Verdict("clear")
        return straight(-limits.retract_speed_m_s)
