"""Staging: back to where a trolley is taken up, and take it up; or back there with a trolley, to try again."""

from __future__ import annotations

from typing import Literal

from common.messages import Drives
from common.timing import NS_PER_S
from follower.supervisor.attempt import Attempt, Since, not_enabled
from follower.supervisor.observed import Observed, Orders, Verdict, straight
from follower.supervisor.phases.phase import PhaseLogic, failed

Stage = Literal["check", "open", "back", "stand", "close"]
_STAND_S = 0.5
_HEALTHY_S = 2.0
_HELD_S = 0.5
_CHECK_TIMEOUT_S = 5.0
_SPARE_S = 10.0
_NEAR_M = 0.02


class Staging(PhaseLogic):
    """``check`` → ``open`` the grippers → ``back`` by odometry → ``stand`` → ``close`` on the trolley.

    With a trolley in the grippers at the start it is over at once. The way back is straight and measured by the
    wheels, from the last sight of the LEDs; already at or beyond the pose there is none.
    """

    def __init__(self, attempt: Attempt, now_ns: int) -> None:
        super().__init__(attempt, now_ns)
        self._stage: Stage = "check"
        self._stage_ns = now_ns
        self._healthy, self._still, self._gripped = Since(), Since(), Since()
        self._back_m = 0.0
        self._back_from_m: float | None = None
        self._stood_ns: int | None = None

    def step(self, seen: Observed) -> Orders | Verdict:
        """See :class:`PhaseLogic`."""
        if self._stage == "check":
            return self._check(seen)
        drives = seen.drives
        if drives is None or not self.attempt.obeyed(drives):
            # the sequence ends what stays silent; until then nothing moves
            return self._overdue(seen, self.limits.acquire_timeout_s, f"staging_timeout: {not_enabled(seen.drives)}")
        if self._stage == "open":
            return self._open(seen)
        if self._stage == "back":
            return self._back(seen, drives)
        if self._stage == "stand":
            return self._stand(seen)
        return self._close(seen)

    def _check(self, seen: Observed) -> Orders | Verdict:
        """Nothing is armed before all is well; a retry wants it well for 2 s, and the LEDs in sight."""
        attempt = self.attempt
        gripped = seen.arms is not None and seen.arms.gripped
        if gripped and not attempt.retreating:
            attempt.grip = "closed"  # it may have been left open by the docking before
            return Verdict("gripped")
        lacking = attempt.unwell(seen) or attempt.rolling() or attempt.leader_unready(seen)
        if attempt.retreating:
            lacking = lacking or attempt.blind(seen) or ("" if gripped else "trolley not gripped")
        to_goal_m = attempt.to_goal_m()
        if not lacking and to_goal_m is None:
            lacking = "the Leader was not seen yet"
        healthy_s = self._healthy.held_s(not lacking, seen.now_ns)
        if lacking or to_goal_m is None or (attempt.retreating and healthy_s < _HEALTHY_S):
            wait = Orders(waiting=lacking or "health")
            return failed(f"staging_timeout: {lacking}") if self.elapsed_s(seen) > _CHECK_TIMEOUT_S else wait
        docking = attempt.config.docking
        self._back_m = docking.staging_distance_m - to_goal_m
        farthest_m = docking.staging_distance_m + docking.trolley_pitch_m + self.limits.push_limit_m
        if self._back_m > farthest_m:
            # nothing looks backwards: a wrong number must not send it across the hall
            far = f"{self._back_m:.1f} m back, more than {farthest_m:.1f} m: is it trolley {attempt.trolley}?"
            return failed(f"staging_timeout: {far}")
        attempt.armed = True
        return self._enter("back" if attempt.retreating else "open", seen)

    def _open(self, seen: Observed) -> Orders | Verdict:
        self.attempt.grip = "open"
        if seen.arms is not None and seen.arms.released:
            return self._enter("back" if self._stood_ns is None else "stand", seen)
        return self._overdue(seen, self.limits.grip_timeout_s, "release_timeout", "grippers to open")

    def _back(self, seen: Observed, drives: Drives) -> Orders | Verdict:
        odometer_m = self.attempt.odometer_m(drives)
        if self._back_from_m is None:
            self._back_from_m = odometer_m
        left_m = self._back_m - (self._back_from_m - odometer_m)
        if left_m <= _NEAR_M:
            return self._enter("stand", seen)
        speed = self.limits.retract_speed_m_s
        if self._stage_s(seen) > 1.5 * self._back_m / speed + _SPARE_S:
            return failed("staging_timeout: the way back is not covered")
        return straight(-speed, waiting="staging pose")

    def _stand(self, seen: Observed) -> Orders | Verdict:
        if self._stood_ns is None:
            self._stood_ns = seen.now_ns
        still_s = self._still.held_s(self.attempt.standstill.holds, seen.now_ns)
        if self.attempt.retreating:
            if still_s < _STAND_S:
                return Orders(waiting="standstill")
            self.attempt.retreating = False
            return Verdict("gripped")
        if seen.now_ns - self._stood_ns > self.limits.trolley_timeout_s * NS_PER_S:
            return failed("no_trolley")
        if still_s >= max(_STAND_S, self.limits.trolley_wait_s):
            return self._enter("close", seen)
        return Orders(waiting="trolley")

    def _close(self, seen: Observed) -> Orders | Verdict:
        self.attempt.grip = "closed"
        if self._gripped.held_s(seen.arms is not None and seen.arms.gripped, seen.now_ns) >= _HELD_S:
            return Verdict("gripped")
        if self._stage_s(seen) > self.limits.grip_timeout_s:
            return self._enter("open", seen)
        return Orders(waiting="grip on the trolley")

    def _enter(self, stage: Stage, seen: Observed) -> Orders:
        """The next stage, from the next step on; this one stands."""
        self._stage, self._stage_ns = stage, seen.now_ns
        self._still, self._gripped = Since(), Since()
        return Orders(waiting="staging pose")

    def _stage_s(self, seen: Observed) -> float:
        return (seen.now_ns - self._stage_ns) / NS_PER_S

    def _overdue(self, seen: Observed, limit_s: float, cause: str, waiting: str = "drives") -> Orders | Verdict:
        return failed(cause) if self._stage_s(seen) > limit_s else Orders(waiting=waiting)
