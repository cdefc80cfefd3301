"""Guide and lock of the Leader as a pure state machine: switches and current in, the actuator's direction out.

The bolt extends behind a beam that is in its seat. After a jam on the way, or a lock switch that closes before the
bolt can have arrived, it retracts once, then the fault latches until the operator resets it.
It retracts only on request, while the Follower is known to stand and to hold nothing against the queue; if that
changes meanwhile, it closes again.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from common.config import LeaderConfig
from common.messages import Answer, FollowerSummary, LockRequest, LockState
from common.timing import NS_PER_MS, NS_PER_S, HeldFor

_JAM_NS: Final = 60 * NS_PER_MS
_SETTLE_NS: Final = 100 * NS_PER_MS


@dataclass(frozen=True, kw_only=True)
class LockInputs:
    """What the I/O module reads of guide and lock."""

    actuator_current_a: float
    guide_lifted: bool
    beam_seated: bool
    lock_extended: bool
    lock_retracted: bool


def interlock(follower: FollowerSummary | None) -> str:
    """Why the lock may not open now; empty if it may. Without its summary the Follower counts as moving."""
    if follower is None:
        return "no summary from the Follower: it may be moving or holding a trolley against the queue"
    if follower.moving:
        return f"the Follower is moving (phase {follower.phase})"
    if follower.in_contact:
        return (
            f"the Follower may hold a trolley against the queue (phase {follower.phase}): "
            "open its grippers first (davpc grip open)"
        )
    return ""


class BoltLock:
    """Steps with each reading. ``queue`` is the number of locked trolleys, None if unknown.

    Args:
        config: travel time and current limit.
        queue: as saved before a restart; None: unknown.
    """

    def __init__(self, config: LeaderConfig, queue: int | None) -> None:
        self._config = config
        self._state: LockState | None = None
        self._since_ns = 0
        self._pending: LockRequest | None = None
        self._jam = HeldFor(_JAM_NS, strictly=True)
        self._contradiction = HeldFor(_SETTLE_NS, strictly=True)
        self._retracting_jam = ""
        self._reversed = self._was_locked = False
        self.queue = queue
        self.cause = ""

    @property
    def state(self) -> LockState:
        """Where the lock is; ``fault`` before the first reading."""
        return self._state or "fault"

    @property
    def direction(self) -> int:
        """Command to the actuator: 1 extend, −1 retract, 0 stay."""
        return {"closing": 1, "opening": -1}.get(self.state, 0)

    # --- requests

    def ask(
        self, request: LockRequest, now_ns: int, inputs: LockInputs, follower: FollowerSummary | None
    ) -> Answer | None:
        """Take a request.

        Args:
            request: what the Follower's supervisor or the operator asks.
            now_ns: time of this step.
            inputs: newest reading of the I/O module.
            follower: the Follower's newest summary, None if too old.

        Returns:
            The answer; None if it follows from :meth:`step` once the bolt has moved.
        """
        self._initialise(now_ns, inputs)
        if self._pending is not None:
            return Answer(request.id, "refused", f"busy with request {self._pending.id}")
        if self._state in ("closing", "opening"):
            return Answer(request.id, "refused", f"the lock is {self._state}")
        if request.action == "reset":
            return self._reset(request, now_ns, inputs, follower)
        if self._state == "fault":
            return Answer(request.id, "refused", f"lock fault: {self.cause}: reset it (davpc lock reset)")
        if request.action == "lock":
            return self._lock(request, now_ns, inputs)
        if request.action == "confirm":
            return self._confirm(request)
        if request.action == "count":
            return self._count(request)
        return self._unlock(request, now_ns, follower)

    def _lock(self, request: LockRequest, now_ns: int, inputs: LockInputs) -> Answer | None:
        if self._state == "locked":
            return Answer(request.id, "done", "already locked")
        if not inputs.beam_seated:
            return Answer(request.id, "refused", "no beam in the guide")
        self._pending = request
        self._enter("closing", now_ns)
        return None

    def _confirm(self, request: LockRequest) -> Answer:
        if self._state != "locked":
            return Answer(request.id, "refused", f"the lock is {self._state}")
        if self.queue is None:
            return Answer(
                request.id, "refused", "the number of trolleys in the queue is unknown: enter it (davpc lock count N)"
            )
        if self.queue not in (request.trolley - 1, request.trolley):
            return Answer(request.id, "refused", f"the queue has {self.queue} trolleys, not {request.trolley - 1}")
        self.queue = request.trolley
        return Answer(request.id, "done", f"still locked, {self.queue} trolleys")

    def _count(self, request: LockRequest) -> Answer:
        if not request.confirmed:
            return Answer(request.id, "refused", "setting the count needs the operator's confirmation")
        if (request.trolley == 0) != (self._state == "open"):
            return Answer(
                request.id, "refused", f"the lock is {self._state}: this contradicts {request.trolley} trolleys"
            )
        self.queue = request.trolley
        return Answer(request.id, "done", f"{self.queue} trolleys")

    def _unlock(self, request: LockRequest, now_ns: int, follower: FollowerSummary | None) -> Answer | None:
        if self._state == "open":
            return Answer(request.id, "done", "already open")
        refusal = interlock(follower)
        if refusal:
            return Answer(request.id, "refused", refusal)
        if not request.confirmed:
            held = "an unknown number of trolleys" if self.queue is None else f"{self.queue} trolleys"
            return Answer(request.id, "refused", f"{held} would be released: this needs the operator's confirmation")
        self._pending, self._was_locked = request, self._state == "locked"
        self._enter("opening", now_ns)
        return None

    def _reset(
        self, request: LockRequest, now_ns: int, inputs: LockInputs, follower: FollowerSummary | None
    ) -> Answer | None:
        """From a fault to where the switches show the bolt; a bolt half-way is retracted, as when unlocking."""
        if self._state != "fault":
            return Answer(request.id, "done", f"nothing to reset: {self._state}")
        if inputs.lock_extended and inputs.lock_retracted:
            return Answer(request.id, "refused", "both lock switches are closed: check the switches")
        if inputs.lock_extended or inputs.lock_retracted:
            self._settle_where_it_is(now_ns, inputs)
            return Answer(request.id, "done", self.state)
        refusal = interlock(follower)
        if refusal:
            return Answer(request.id, "refused", refusal)
        if not request.confirmed:
            return Answer(
                request.id,
                "refused",
                "the bolt is half-way and would be retracted: this needs the operator's confirmation",
            )
        self._pending, self._was_locked = request, False
        self.cause = ""
        self._enter("opening", now_ns)
        return None

    # --- time

    def step(self, now_ns: int, inputs: LockInputs, follower: FollowerSummary | None) -> Answer | None:
        """One step; the answer to the request that it settled, None if it settled none."""
        self._initialise(now_ns, inputs)
        if self._state == "closing":
            return self._closing(now_ns, inputs)
        if self._state == "opening":
            return self._opening(now_ns, inputs, follower)
        self._check_switches(now_ns, inputs)
        return None

    def _closing(self, now_ns: int, inputs: LockInputs) -> Answer | None:
        there = inputs.lock_extended and not inputs.lock_retracted
        # on its way back after a lock began to open, the bolt may be near its end
        near = self._reversed and self._was_locked
        too_soon = there and not near and self._travelled_s(now_ns) < self._config.lock_travel_least_s
        if there and not too_soon:
            if not self._reversed:
                self.queue = 1
            elif self.queue == 0:
                self.queue = None  # opened after a fault: something may be locked that was never counted
            return self._settle("locked", "done", "locked", now_ns)
        jam = ""
        if too_soon:
            jam = f"lock switch closed after {self._travelled_s(now_ns):.2f} s, before the bolt can have arrived"
        elif self._jammed(now_ns, inputs):
            jam = "actuator jammed: current limit"
        elif self._overdue(now_ns):
            jam = "lock switch not reached in time"
        if not jam:
            return None
        if self._reversed:
            # it was locked before: retracting would release the queue
            return self._settle("fault", "refused", jam, now_ns)
        self._retracting_jam = jam
        self._enter("opening", now_ns)
        return None

    def _opening(self, now_ns: int, inputs: LockInputs, follower: FollowerSummary | None) -> Answer | None:
        if inputs.lock_retracted and not inputs.lock_extended:
            if self._retracting_jam:
                return self._settle("fault", "refused", f"{self._retracting_jam}; retracted", now_ns)
            self.queue = 0
            return self._settle("open", "done", "open", now_ns)
        broken = interlock(follower) if not self._retracting_jam else ""
        if broken:
            self._reversed = True
            pending, self._pending = self._pending, None
            self._enter("closing", now_ns)
            return Answer(pending.id, "refused", f"closing again: {broken}") if pending is not None else None
        if self._jammed(now_ns, inputs) or self._overdue(now_ns):
            first = f"{self._retracting_jam}; " if self._retracting_jam else ""
            both = inputs.lock_extended and inputs.lock_retracted
            why = "both lock switches closed" if both else "retracted switch not reached in time"
            return self._settle("fault", "refused", f"{first}{why}", now_ns)
        return None

    def _check_switches(self, now_ns: int, inputs: LockInputs) -> None:
        """Switches that contradict a lock at rest: one stuck closed, one lost."""
        wrong = ""
        if self._state == "open" and inputs.lock_extended:
            wrong = "lock switch closed while the lock is open"
        elif self._state == "open" and not inputs.lock_retracted:
            wrong = "retracted switch lost while the lock is open"
        elif self._state == "locked" and not inputs.lock_extended:
            wrong = "lock switch lost while locked"
        elif self._state == "locked" and inputs.lock_retracted:
            wrong = "retracted switch closed while locked"
        if self._contradiction.step(now_ns, bool(wrong)):
            self.cause = wrong
            self._enter("fault", now_ns)

    def _jammed(self, now_ns: int, inputs: LockInputs) -> bool:
        """More current than the limit for longer than an inrush."""
        return self._jam.step(now_ns, inputs.actuator_current_a > self._config.actuator_current_limit_a)

    def _overdue(self, now_ns: int) -> bool:
        return self._travelled_s(now_ns) > self._config.lock_travel_timeout_s

    def _travelled_s(self, now_ns: int) -> float:
        """For how long the bolt has been moving in this direction."""
        return (now_ns - self._since_ns) / NS_PER_S

    def _initialise(self, now_ns: int, inputs: LockInputs) -> None:
        """After a start the lock is where its switches show it."""
        if self._state is not None:
            return
        if inputs.lock_extended == inputs.lock_retracted:
            self.cause = "at start-up both lock switches are closed, or neither is"
            self._enter("fault", now_ns)
        else:
            self._settle_where_it_is(now_ns, inputs)

    def _settle_where_it_is(self, now_ns: int, inputs: LockInputs) -> None:
        self.cause = ""
        self._enter("locked" if inputs.lock_extended else "open", now_ns)
        if self._state == "open":
            self.queue = 0
        elif self.queue == 0:
            self.queue = None  # something is locked that was never counted

    def _settle(self, state: LockState, outcome: str, reason: str, now_ns: int) -> Answer | None:
        pending, self._pending = self._pending, None
        if state == "fault":
            self.cause = reason
        self._enter(state, now_ns)
        self._retracting_jam, self._reversed = "", False
        if pending is None:
            return None
        return Answer(pending.id, "done" if outcome == "done" else "refused", reason)

    def _enter(self, state: LockState, now_ns: int) -> None:
        self._state, self._since_ns = state, now_ns
        self._jam.reset()
        self._contradiction.reset()
