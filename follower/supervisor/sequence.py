"""The phases of one docking as a pure state machine: what is observed in, the mission out.

The table of phases is :mod:`follower.supervisor.transitions`; what happens within one is a class of its own. This
owns the epoch and the arm token; it only withholds or lowers motion, the gate decides what reaches the bus.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from common.causes import BAD_FRAMES, NODE_SILENT, cause_code, needs_reset
from common.config import Config
from common.geometry import Array
from common.messages import Answer, DockRequest, Drives, FollowerSummary, Mission, Phase
from common.timing import NS_PER_S
from follower.model.dead_reckoning import WheelReckoning
from follower.supervisor.attempt import Attempt
from follower.supervisor.observed import Decided, Observed, Orders, Verdict
from follower.supervisor.phases.acquire import Acquire, Search
from follower.supervisor.phases.approach import Approach
from follower.supervisor.phases.contact import Insert, Push
from follower.supervisor.phases.lock import Lock, Release, Retract
from follower.supervisor.phases.phase import PhaseLogic
from follower.supervisor.phases.staging import Staging
from follower.supervisor.standstill import Standstill
from follower.supervisor.transitions import ENDED, FREE, IN_CONTACT, Event, next_phase

_SILENT_NS = NS_PER_S // 4
# what passes by itself: somebody was late, or the machine stood still
REARMING_CAUSES: Final = frozenset(
    {
        "command_age",
        "valid_until",
        "token_age",
        "status_age",
        "arm_setpoint_age",
        "bridge_stalled",
        NODE_SILENT,
        BAD_FRAMES,
    }
)
# a longer step was a stall of this process: it says nothing of the others
_LONGEST_STEP_NS = NS_PER_S // 10
# before its goal with a trolley, nothing touches the queue from here on
_CLEAR_M: Final = 0.3
_LOGIC: Final[dict[Phase, type[PhaseLogic]]] = {
    "staging": Staging,
    "acquire": Acquire,
    "search": Search,
    "approach": Approach,
    "insert": Insert,
    "push": Push,
    "lock": Lock,
    "release": Release,
    "retract": Retract,
}
_HOLD: Final = Orders()


class DockingSequence:
    """Steps at 20 Hz; time comes in with what is observed.

    Args:
        config: the pair's configuration.
        run_id: of this start of the supervisor; no epoch of an earlier run comes again.
        taught: (n, 2) desired features by trolley; None: geometry gives them.
    """

    def __init__(self, config: Config, run_id: int, taught: Mapping[int, Array] | None = None) -> None:
        self._config = config
        self._taught = taught
        self._epoch = run_id
        self._phase: Phase = "idle"
        self._logic: PhaseLogic | None = None
        self._cause = ""
        self._resets = 0
        self._before_ns: int | None = None
        self._drives_silent_ns = 0
        self._reckoning = WheelReckoning(config.base, config.estimator)
        self._standstill = Standstill(config.base)
        self._attempt = Attempt(config, 1, run_id, None, self._reckoning, self._standstill)
        self._apart: bool | None = None
        self._touched = 0

    @property
    def phase(self) -> Phase:
        """Where the docking stands."""
        return self._phase

    @property
    def attempt(self) -> Attempt:
        """The docking under way, or the last one."""
        return self._attempt

    def step(self, seen: Observed) -> Decided:
        """Take one step."""
        answers = tuple(self._answer(request, seen) for request in seen.requests)
        self._look(seen)
        self._touch(seen)
        ended = self._watch(seen) if self._phase not in ENDED else None
        if ended is not None:
            self._follow(ended, seen)
        orders = self._orders(seen)
        return Decided(self._mission(orders), self._summary(seen, orders), answers, orders.lock_request)

    def _look(self, seen: Observed) -> None:
        """Follow the Leader by odometry, and by sight while that is where it must be."""
        elapsed_ns = 0 if self._before_ns is None else seen.now_ns - self._before_ns
        self._before_ns = seen.now_ns
        self._standstill.step(seen.now_ns, seen.drives)
        if seen.drives is not None:
            self._drives_silent_ns = 0
            self._reckoning.drive(seen.drives)
        else:
            self._drives_silent_ns += min(elapsed_ns, _LONGEST_STEP_NS)
        state = seen.state
        if state is not None and state.valid and (not self._attempt.armed or self._reckoning.agrees(state)):
            self._reckoning.seen(state)

    def _touch(self, seen: Observed) -> None:
        """Whether the trolley in the grippers is apart from guide and queue; None: nobody knows.

        What was in contact stays so over a reset and a new docking, until it is let go or seen clear of the queue.
        """
        if self._phase in IN_CONTACT:
            self._apart, self._touched = False, self._attempt.trolley
        elif self._clear_of_queue(seen):
            self._apart, self._touched = True, 0
        elif seen.arms is not None and seen.arms.released:
            self._apart = None

    def _clear_of_queue(self, seen: Observed) -> bool:
        """By sight and odometry; the queue is as long as the Leader counts, or as what was touched last."""
        pose, leader = self._reckoning.leader_in_follower, seen.leader
        if pose is None or leader is None or leader.queue is None:
            return False
        next_one = max(leader.queue + 1, self._touched)
        return pose.x_m - self._config.docking.goal(next_one).x_m > _CLEAR_M

    def _orders(self, seen: Observed) -> Orders:
        """What the phase wants; a phase that ends hands over to the next at once."""
        for _ in range(len(_LOGIC)):
            if self._logic is None:
                return _HOLD
            wanted = self._logic.step(seen)
            if isinstance(wanted, Orders):
                return wanted
            self._follow(wanted, seen)
        return _HOLD

    # --- requests

    def _answer(self, request: DockRequest, seen: Observed) -> Answer:
        if seen.now_ns > request.expires_ns:
            return Answer(request.id, "expired", "came after its expiry")
        if request.action == "abort":
            if self._phase in ENDED:
                return Answer(request.id, "done", f"nothing to abort in phase {self._phase}")
            self._follow(Verdict("abort", "operator_abort"), seen)
            return Answer(request.id, "done", "aborted")
        if request.action == "reset":
            if self._phase not in ENDED:
                return Answer(request.id, "refused", f"phase {self._phase} is under way")
            self._follow(Verdict("reset"), seen)
            self._resets += 1
            return Answer(request.id, "done", "idle")
        refusal = self._refusal(request, seen)
        if refusal:
            return Answer(request.id, "refused", refusal)
        self._begin(request.trolley, seen)
        return Answer(request.id, "accepted", f"docking trolley {request.trolley}")

    def _refusal(self, request: DockRequest, seen: Observed) -> str:
        if self._phase not in ENDED:
            return f"phase {self._phase} is under way"
        if self._latched():
            return f"stopped by {self._cause}: reset first (davpc dock reset)"
        if self._taught is not None and request.trolley not in self._taught:
            return f"docking {request.trolley} is not taught (docking.taught_dir)"
        return seen.unfit

    def _latched(self) -> bool:
        """After S2, and after whatever ended it in contact: then the trolley still stands there, held."""
        in_contact = self._attempt.contact_begin_m is not None or self._apart is False
        return self._phase == "aborted" and (in_contact or needs_reset(self._cause))

    def _begin(self, trolley: int, seen: Observed) -> None:
        grip = self._attempt.grip
        self._epoch += 1
        self._attempt = Attempt(
            self._config, trolley, self._epoch, self._taught, self._reckoning, self._standstill, grip
        )
        self._follow(Verdict("start"), seen)

    # --- what ends a docking in any phase

    def _watch(self, seen: Observed) -> Verdict | None:
        attempt, drives = self._attempt, seen.drives
        if seen.restarted:
            return Verdict("failed", f"restarted: {seen.restarted}")
        if drives is None:
            silent = attempt.armed and self._drives_silent_ns > _SILENT_NS
            return Verdict("failed", "drives_silent") if silent else None
        attempt.enabled = attempt.enabled or attempt.obeyed(drives)
        if not drives.stop_inputs_clear and not _unheard(drives):
            return Verdict("failed", "stop_input")
        if drives.state == "fault":
            return Verdict("failed", f"drive_fault: {drives.cause}")
        if attempt.armed and drives.state == "stopped" and drives.epoch == self._epoch:
            return self._stopped(drives, seen.now_ns)
        if attempt.enabled and not attempt.obeyed(drives):
            return Verdict("failed", f"drives_disarmed: {drives.cause or 'by themselves'}")
        if attempt.armed and seen.arms is not None and seen.arms.cause != "ok":
            # the arms already yield, the drives then hold where they are; no pursuit
            return Verdict("failed", seen.arms.cause)
        early = attempt.trolley == 1 and self._phase in ("approach", "insert", "push")
        if early and seen.leader is not None and seen.leader.lock == "locked":
            return Verdict("failed", "lock_implausible")
        return None

    def _stopped(self, drives: Drives, now_ns: int) -> Verdict:
        """S1: the gate stopped and disarmed. While nothing is in contact, arm anew once all is well, a few times."""
        attempt = self._attempt
        again = cause_code(drives.cause) in REARMING_CAUSES and attempt.may_rearm(now_ns)
        if again and self._phase in FREE:
            return Verdict("late")
        return Verdict("failed", f"gate_stop: {drives.cause}")

    def _follow(self, verdict: Verdict, seen: Observed) -> None:
        """Go where the table says."""
        event: Event = verdict.event
        self._phase = next_phase(self._phase, event)
        attempt = self._attempt
        if event == "late":
            attempt.rearmed_ns.append(seen.now_ns)
            self._epoch += 1
            attempt.epoch = self._epoch
        if event == "late" or self._phase in ENDED:
            attempt.armed = attempt.enabled = False
        if event in ("start", "reset", "failed", "abort"):
            self._cause = verdict.cause
        logic = _LOGIC.get(self._phase)
        self._logic = logic(attempt, seen.now_ns) if logic is not None else None

    # --- what the others are told

    def _mission(self, orders: Orders) -> Mission:
        attempt = self._attempt
        return Mission(
            phase=self._phase,
            cause=self._cause[:400],
            trolley=attempt.trolley,
            epoch=self._epoch,
            armed=attempt.armed,
            motion=orders.motion if attempt.armed else "hold",
            straight_speed_m_s=orders.straight_speed_m_s,
            v_max_m_s=orders.v_max_m_s,
            w_max_rad_s=orders.w_max_rad_s,
            goal_theta_rad=attempt.goal.theta_rad,
            desired_features=tuple((float(a), float(b)) for a, b in attempt.desired),
            grip=attempt.grip,
            contact_expected=orders.contact_expected,
            resets=self._resets,
            waiting=orders.waiting[:400],
            needs_reset=self._latched(),
            turn_rate_rad_s=orders.turn_rate_rad_s,
        )

    def _summary(self, seen: Observed, orders: Orders) -> FollowerSummary:
        """Careful: what is not known counts as moving, and as in contact."""
        attempt = self._attempt
        still = seen.drives is not None and self._standstill.holds
        held = seen.arms is None or not seen.arms.released
        return FollowerSummary(
            phase=self._phase,
            cause=self._cause[:400],
            waiting=orders.waiting[:400],
            trolley=attempt.trolley,
            armed=attempt.armed,
            moving=not still or (attempt.armed and orders.motion != "hold"),
            in_contact=held and (self._phase in IN_CONTACT or self._apart is not True),
            gripped=seen.arms is not None and seen.arms.gripped,
            needs_reset=self._latched(),
        )


def _unheard(drives: Drives) -> bool:
    """Whether the gate stopped because the drives were not heard: then the stop inputs were not either.

    That is no pressed button, and a pressed one is told in the next step: the new epoch clears the gate's cause.
    """
    return drives.state == "stopped" and cause_code(drives.cause) in (NODE_SILENT, "status_age", "bridge_stalled")
