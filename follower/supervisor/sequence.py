"""The phases of one docking as a pure state machine: what is observed in, the mission out.

``acquire → approach → push → lock → release → retract → done``, and from each ``aborted`` with a named cause.
It owns the epoch and the arm token; it only withholds or lowers motion, the gate decides what reaches the bus.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from common.config import Config
from common.geometry import Array, features_at
from common.messages import (
    Answer,
    ArmState,
    DockingState,
    DockRequest,
    Drives,
    LeaderState,
    LockRequest,
    Mission,
    Phase,
)
from common.timing import NS_PER_S

_CONFIRM_NS = NS_PER_S // 2
_SILENT_NS = NS_PER_S // 4
_LOCK_REPEAT_NS = NS_PER_S
_PUSH_STROKE_SHARE = 0.8
# what passes by itself: somebody was late
REARMING_CAUSES = frozenset({"command_age", "valid_until", "token_age", "status_age", "arm_setpoint_age"})
MAX_REARMED = 3
LAST_METRE_M = 1.0


@dataclass(frozen=True)
class Observed:
    """What the supervisor sees in one step; None is what is missing or too old."""

    now_ns: int
    state: DockingState | None
    drives: Drives | None
    arms: ArmState | None
    leader: LeaderState | None
    controller_alive: bool
    requests: tuple[DockRequest, ...] = ()
    lock_answers: tuple[Answer, ...] = ()


@dataclass(frozen=True)
class Decided:
    """What the supervisor wants: the mission, answers to people, at most one request to the Leader."""

    mission: Mission
    answers: tuple[Answer, ...] = ()
    lock_request: LockRequest | None = None


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
        self._cause = ""
        self._trolley = 1
        self._armed = False
        self._since_ns = 0
        self._holding_since_ns: int | None = None
        self._missing_since_ns: int | None = None
        self._drives_seen_ns = 0
        self._odometer_start_m: float | None = None
        self._lock_id = ""
        self._lock_confirmed = False
        self._lock_asked_ns = 0
        self._rearmed = 0
        self._resets = 0

    @property
    def phase(self) -> Phase:
        """Where the docking stands."""
        return self._phase

    def step(self, seen: Observed) -> Decided:
        """Take one step."""
        answers = tuple(self._answer(request, seen.now_ns) for request in seen.requests)
        if seen.drives is not None:
            self._drives_seen_ns = seen.now_ns
        if self._phase not in ("idle", "done", "aborted"):
            self._watch(seen)
        handler = getattr(self, f"_{self._phase}", None)
        request = handler(seen) if handler is not None else None
        return Decided(self._mission(seen), answers, request)

    # --- requests

    def _answer(self, request: DockRequest, now_ns: int) -> Answer:
        if now_ns > request.expires_ns:
            return Answer(request.id, "expired", "came after its expiry")
        if request.action == "abort":
            if self._phase in ("idle", "done", "aborted"):
                return Answer(request.id, "done", f"nothing to abort in phase {self._phase}")
            self._abort("operator_abort", now_ns)
            return Answer(request.id, "done", "aborted")
        if request.action == "reset":
            if self._phase not in ("aborted", "done", "idle"):
                return Answer(request.id, "refused", f"phase {self._phase} is under way")
            self._enter("idle", now_ns)
            self._cause = ""
            self._resets += 1
            return Answer(request.id, "done", "idle")
        if self._phase != "idle":
            return Answer(request.id, "refused", f"phase is {self._phase}, not idle")
        if self._taught is not None and request.trolley not in self._taught:
            return Answer(request.id, "refused", f"docking {request.trolley} is not taught (docking.taught_dir)")
        self._trolley = request.trolley
        self._rearmed = 0
        self._epoch += 1
        self._enter("acquire", now_ns)
        return Answer(request.id, "accepted", f"docking trolley {request.trolley}")

    # --- what ends a docking in any phase

    def _watch(self, seen: Observed) -> None:
        drives = seen.drives
        if drives is None:
            if seen.now_ns - max(self._drives_seen_ns, self._since_ns) > _SILENT_NS and self._phase != "acquire":
                self._abort("drives_silent", seen.now_ns)
        elif not drives.stop_inputs_clear:
            self._abort("stop_input", seen.now_ns)
        elif drives.state == "fault":
            self._abort(f"drive_fault: {drives.cause}", seen.now_ns)
        elif self._armed and drives.state == "stopped" and drives.epoch == self._epoch:
            self._stopped(drives.cause, seen.now_ns)
        elif self._phase != "acquire" and (drives.state != "armed" or drives.epoch != self._epoch):
            self._abort(f"drives_{drives.state}: {drives.cause or 'disarmed by themselves'}", seen.now_ns)
        elif self._armed and seen.arms is not None and seen.arms.cause != "ok":
            # slip (S1, no pursuit) and collision (S2): the arms already yield, the drives then hold where they are
            self._abort(seen.arms.cause, seen.now_ns)

    def _stopped(self, cause: str, now_ns: int) -> None:
        """S1: the gate stopped and disarmed. While nothing is in contact, arm anew once all is well, a few times."""
        if self._phase in ("acquire", "approach") and cause in REARMING_CAUSES and self._rearmed < MAX_REARMED:
            self._rearmed += 1
            self._epoch += 1
            self._armed = False
            self._enter("acquire", now_ns)
        else:
            self._abort(f"gate_stop: {cause}", now_ns)

    # --- phases

    def _acquire(self, seen: Observed) -> None:
        missing = self._missing(seen)
        if missing:
            self._holding_since_ns = None
        elif self._holding_since_ns is None:
            self._holding_since_ns = seen.now_ns
        elif seen.now_ns - self._holding_since_ns >= _CONFIRM_NS:
            self._armed = True
        drives = seen.drives
        if self._armed and drives is not None and drives.state == "armed" and drives.epoch == self._epoch:
            self._enter("approach", seen.now_ns)
        elif self._overdue(seen, self._config.supervisor.acquire_timeout_s):
            self._abort(f"acquire_timeout: {missing or 'drives not enabled'}", seen.now_ns)

    def _approach(self, seen: Observed) -> None:
        if seen.arms is not None and seen.arms.connected:
            self._abort("contact_early", seen.now_ns)
            return
        if self._lost(seen):
            return
        if self._arrived(seen.state):
            if self._holding_since_ns is None:
                self._holding_since_ns = seen.now_ns
            elif seen.now_ns - self._holding_since_ns >= self._config.docking.settle_s * NS_PER_S:
                self._enter("push", seen.now_ns)
        else:
            self._holding_since_ns = None
        if self._overdue(seen, self._config.supervisor.approach_timeout_s):
            self._abort("approach_timeout", seen.now_ns)

    def _push(self, seen: Observed) -> None:
        if seen.drives is None:
            return
        pushed_m = self._driven(seen.drives)
        connected = seen.arms is not None and seen.arms.connected
        if connected and pushed_m >= _PUSH_STROKE_SHARE * self._config.docking.push_stroke_m:
            self._enter("lock", seen.now_ns)
        elif connected:
            self._abort("contact_early", seen.now_ns)
        elif pushed_m > self._config.supervisor.push_limit_m:
            self._abort("no_contact", seen.now_ns)
        elif self._overdue(seen, 2 * self._config.supervisor.push_limit_m / self._config.supervisor.push_speed_m_s):
            self._abort("push_timeout", seen.now_ns)

    def _lock(self, seen: Observed) -> LockRequest | None:
        for answer in seen.lock_answers:
            if answer.id == self._lock_id and answer.outcome == "done":
                self._lock_confirmed = True
            elif answer.id == self._lock_id:
                self._abort(f"lock_{answer.outcome}: {answer.reason}", seen.now_ns)
                return None
        if self._lock_confirmed and seen.leader is not None and seen.leader.lock == "locked":
            self._enter("release", seen.now_ns)
        elif self._overdue(seen, self._config.supervisor.lock_timeout_s):
            self._abort("lock_timeout" if seen.leader is not None else "leader_silent", seen.now_ns)
        elif not self._lock_id or seen.now_ns - self._lock_asked_ns >= _LOCK_REPEAT_NS:
            self._lock_id = self._lock_id or f"lock-{self._epoch}"
            self._lock_asked_ns = seen.now_ns
            valid_ms = round(self._config.supervisor.lock_timeout_s * 1000)
            return LockRequest(self._lock_id, valid_ms, "lock", self._trolley)
        return None

    def _release(self, seen: Observed) -> None:
        if seen.arms is not None and seen.arms.released:
            self._enter("retract", seen.now_ns)
        elif self._overdue(seen, self._config.supervisor.lock_timeout_s):
            self._abort("release_timeout", seen.now_ns)

    def _retract(self, seen: Observed) -> None:
        limits = self._config.supervisor
        if seen.drives is not None and -self._driven(seen.drives) >= limits.retract_distance_m:
            self._enter("done", seen.now_ns)
            self._armed = False
        elif self._overdue(seen, 3 * limits.retract_distance_m / limits.retract_speed_m_s):
            self._abort("retract_timeout", seen.now_ns)

    # --- judgements

    def _missing(self, seen: Observed) -> str:
        """What still keeps the robot from arming; empty if nothing does."""
        if seen.drives is None:
            return "no drives"
        if seen.state is None:
            return "no docking state"
        if not seen.state.valid:
            return f"LEDs not acquired ({seen.state.cause})"
        if not seen.controller_alive:
            return "controller silent"
        if seen.arms is None or not seen.arms.gripped:
            return "no trolley in the grippers"
        if self._trolley == 1 and seen.leader is not None and seen.leader.lock != "open":
            return f"the Leader's lock is {seen.leader.lock}, not open for trolley 1"
        return ""

    def _lost(self, seen: Observed) -> bool:
        if seen.state is not None and seen.state.valid:
            self._missing_since_ns = None
            return False
        self._missing_since_ns = self._missing_since_ns or seen.now_ns
        if seen.now_ns - self._missing_since_ns > self._config.supervisor.lost_timeout_s * NS_PER_S:
            self._abort("leds_lost" if seen.state is not None else "estimator_silent", seen.now_ns)
        return True

    def _arrived(self, state: DockingState | None) -> bool:
        """The stop test of Algorithm 1, on the filtered state: on the raw one it would see the noise."""
        if state is None or not state.features_filtered:
            return False
        docking = self._config.docking
        desired = self._desired()
        worst = max(
            max(abs(a - da), abs(b - db)) for (a, b), (da, db) in zip(state.features_filtered, desired, strict=True)
        )
        return worst <= docking.feature_tolerance and abs(state.theta_rad) <= docking.heading_tolerance_deg / 57.29578

    def _desired(self) -> tuple[tuple[float, float], ...]:
        config = self._config
        if self._taught is not None:
            features = self._taught[self._trolley]
        else:
            features = features_at(config.leds.points, config.docking.goal(self._trolley), config.camera.mount)
        return tuple((float(a), float(b)) for a, b in features)

    def _driven(self, drives: Drives) -> float:
        """Metres driven since the phase began, by the wheels."""
        odometer = sum(drives.wheel_angle_rad) / 2 * self._config.base.wheel_radius_m
        if self._odometer_start_m is None:
            self._odometer_start_m = odometer
        return odometer - self._odometer_start_m

    def _overdue(self, seen: Observed, limit_s: float) -> bool:
        return seen.now_ns - self._since_ns > limit_s * NS_PER_S

    def _abort(self, cause: str, now_ns: int) -> None:
        self._cause = cause
        self._armed = False
        self._enter("aborted", now_ns)

    def _enter(self, phase: Phase, now_ns: int) -> None:
        self._phase = phase
        self._since_ns = now_ns
        self._holding_since_ns = self._missing_since_ns = None
        self._odometer_start_m = None
        if phase == "acquire":
            self._cause = self._lock_id = ""
            self._lock_confirmed = False

    # --- what the others are told

    def _mission(self, seen: Observed) -> Mission:
        config, limits = self._config, self._config.supervisor
        goal = config.docking.goal(self._trolley)
        base = Mission(
            phase=self._phase,
            cause=self._cause,
            trolley=self._trolley,
            method=config.controller.method,
            epoch=self._epoch,
            armed=self._armed,
            motion="hold",
            straight_speed_m_s=0.0,
            v_max_m_s=0.0,
            w_max_rad_s=0.0,
            goal_theta_rad=goal.theta_rad,
            desired_features=self._desired(),
            grip="open" if self._phase in ("release", "retract", "done") else "closed",
            push=self._phase in ("push", "lock"),
            resets=self._resets,
        )
        if self._phase == "approach" and seen.state is not None and seen.state.valid:
            far = seen.state.x_m - goal.x_m > LAST_METRE_M
            v_max = limits.approach_speed_m_s if far else limits.last_metre_speed_m_s
            return replace(base, motion="servo", v_max_m_s=v_max, w_max_rad_s=config.limits.w_max_rad_s)
        if self._phase == "push":
            speed = limits.push_speed_m_s
            return replace(base, motion="straight", straight_speed_m_s=speed, v_max_m_s=speed)
        if self._phase == "retract":
            speed = limits.retract_speed_m_s
            return replace(base, motion="straight", straight_speed_m_s=-speed, v_max_m_s=speed)
        return base
