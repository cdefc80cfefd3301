"""The phases of one docking as a pure state machine: inputs in, mission out.

The table of phases is :mod:`follower.supervisor.transitions`; what happens within one is a class of its own. This
owns the epoch and the arm token; it only withholds or reduces motion, the gate decides what reaches the bus.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from common.causes import cause_code, needs_reset
from common.config import Config
from common.geometry import Pose2
from common.messages import Answer, DockRequest, FollowerSummary, Mission, Phase
from common.timing import NS_PER_S
from follower.model.dead_reckoning import WheelReckoning
from follower.standstill import Standstill
from follower.supervisor.attempt import REARMING_CAUSES, Attempt, stopped_by_silence
from follower.supervisor.interface import Grip, PhaseOutputs, PhaseResult, SupervisorInputs, SupervisorOutputs
from follower.supervisor.phases.acquire import AcquirePhase, SearchPhase
from follower.supervisor.phases.approach import ApproachPhase
from follower.supervisor.phases.contact import InsertPhase, PushPhase
from follower.supervisor.phases.lock import LockPhase, ReleasePhase, RetractPhase
from follower.supervisor.phases.phase import PhaseLogic
from follower.supervisor.phases.staging import StagingPhase
from follower.supervisor.transitions import ENDED, FREE, IN_CONTACT, Event, next_phase

_SILENT_NS = NS_PER_S // 4
# a longer step was a stall of this process, not silence of the others
_LONGEST_STEP_NS = NS_PER_S // 10
# farther than this before its goal a trolley in the grippers cannot touch the queue
_CLEAR_M: Final = 0.3
_LOGIC: Final[dict[Phase, type[PhaseLogic]]] = {
    "staging": StagingPhase,
    "acquire": AcquirePhase,
    "search": SearchPhase,
    "approach": ApproachPhase,
    "insert": InsertPhase,
    "push": PushPhase,
    "lock": LockPhase,
    "release": ReleasePhase,
    "retract": RetractPhase,
}
_HOLD: Final = PhaseOutputs()


class DockingSequence:
    """Steps at 20 Hz; time comes with the inputs.

    Args:
        config: the pair's configuration.
        run_id: of this start of the supervisor, so that no epoch of an earlier run repeats.
        taught: where taught dockings end, {L} in {F}, by trolley; all others end at their goals.
    """

    def __init__(self, config: Config, run_id: int, taught: Mapping[int, Pose2] | None = None) -> None:
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
        self._attempt = self._new_attempt(1, None, "closed")
        self._apart: bool | None = None
        self._touched_trolley = 0

    @property
    def phase(self) -> Phase:
        """Current phase of the docking."""
        return self._phase

    @property
    def attempt(self) -> Attempt:
        """The docking in progress, or the last one."""
        return self._attempt

    def step(self, inputs: SupervisorInputs) -> SupervisorOutputs:
        """Take one step."""
        answers = tuple(self._answer(request, inputs) for request in inputs.requests)
        self._update_pose(inputs)
        self._update_contact(inputs)
        ended = self._watch(inputs) if self._phase not in ENDED else None
        if ended is not None:
            self._follow(ended, inputs)
        wanted = self._phase_outputs(inputs)
        return SupervisorOutputs(
            mission=self._mission(wanted),
            summary=self._summary(inputs, wanted),
            answers=answers,
            lock_request=wanted.lock_request,
        )

    def _update_pose(self, inputs: SupervisorInputs) -> None:
        """Track the Leader by odometry, and by the estimate while that agrees."""
        elapsed_ns = 0 if self._before_ns is None else inputs.now_ns - self._before_ns
        self._before_ns = inputs.now_ns
        self._standstill.step(inputs.now_ns, inputs.drives)
        if inputs.drives is not None:
            self._drives_silent_ns = 0
            self._reckoning.drive(inputs.drives)
        else:
            self._drives_silent_ns += min(elapsed_ns, _LONGEST_STEP_NS)
        state = inputs.state
        if state is not None and state.valid and (not self._attempt.armed or self._reckoning.agrees(state)):
            self._reckoning.seen(state)

    def _update_contact(self, inputs: SupervisorInputs) -> None:
        """Whether the trolley in the grippers is apart from guide and queue; None: unknown.

        Contact persists over a reset and a new docking, until the trolley is released or seen clear of the queue.
        """
        if self._phase in IN_CONTACT:
            self._apart, self._touched_trolley = False, self._attempt.trolley
        elif self._clear_of_queue(inputs):
            self._apart, self._touched_trolley = True, 0
        elif inputs.arms is not None and inputs.arms.released:
            self._apart = None

    def _clear_of_queue(self, inputs: SupervisorInputs) -> bool:
        """By estimate and odometry; the queue is as long as the Leader counts, or as the trolley touched last."""
        pose, leader = self._reckoning.leader_in_follower, inputs.leader
        if pose is None or leader is None or leader.queue is None:
            return False
        next_one = max(leader.queue + 1, self._touched_trolley)
        return pose.x_m - self._config.docking.goal(next_one).x_m > _CLEAR_M

    def _phase_outputs(self, inputs: SupervisorInputs) -> PhaseOutputs:
        """What the phase asks for; a phase that ends hands over to the next at once."""
        for _ in range(len(_LOGIC)):
            if self._logic is None:
                return _HOLD
            step = self._logic.step(inputs)
            if isinstance(step, PhaseOutputs):
                return step
            self._follow(step, inputs)
        return _HOLD

    # --- requests

    def _answer(self, request: DockRequest, inputs: SupervisorInputs) -> Answer:
        if inputs.now_ns > request.expires_ns:
            return Answer(request.id, "expired", "expired before it was handled")
        if request.action == "abort":
            if self._phase in ENDED:
                return Answer(request.id, "done", f"nothing to abort in phase {self._phase}")
            self._follow(PhaseResult("abort", "operator_abort"), inputs)
            return Answer(request.id, "done", "aborted")
        if request.action == "reset":
            if self._phase not in ENDED:
                return Answer(request.id, "refused", f"phase {self._phase} is under way")
            self._follow(PhaseResult("reset"), inputs)
            self._resets += 1
            return Answer(request.id, "done", "idle")
        refusal = self._refusal(inputs)
        if refusal:
            return Answer(request.id, "refused", refusal)
        self._begin(request.trolley, inputs)
        return Answer(request.id, "accepted", f"docking trolley {request.trolley}")

    def _refusal(self, inputs: SupervisorInputs) -> str:
        if self._phase not in ENDED:
            return f"phase {self._phase} is under way"
        if self._latched():
            return f"stopped by {self._cause}: reset first (davpc dock reset)"
        return inputs.unfit

    def _latched(self) -> bool:
        """After S2, and after any end in contact: the trolley is still held there."""
        in_contact = self._attempt.contact_begin_m is not None or self._apart is False
        return self._phase == "aborted" and (in_contact or needs_reset(self._cause))

    def _begin(self, trolley: int, inputs: SupervisorInputs) -> None:
        self._epoch += 1
        self._attempt = self._new_attempt(trolley, self._taught, self._attempt.grip)
        self._follow(PhaseResult("start"), inputs)

    def _new_attempt(self, trolley: int, taught: Mapping[int, Pose2] | None, grip: Grip) -> Attempt:
        return Attempt(
            config=self._config,
            trolley=trolley,
            epoch=self._epoch,
            taught=taught,
            reckoning=self._reckoning,
            standstill=self._standstill,
            grip=grip,
        )

    # --- what ends a docking in any phase

    def _watch(self, inputs: SupervisorInputs) -> PhaseResult | None:
        attempt, drives = self._attempt, inputs.drives
        if inputs.restarted:
            return PhaseResult("failed", f"restarted: {inputs.restarted}")
        if inputs.malformed and attempt.armed:
            return self._passing(f"bad_message: of {inputs.malformed}", inputs.now_ns)
        if drives is None:
            silent = attempt.armed and self._drives_silent_ns > _SILENT_NS
            return PhaseResult("failed", "drives_silent") if silent else None
        attempt.enabled = attempt.enabled or attempt.obeyed(drives)
        if not drives.stop_inputs_clear and not stopped_by_silence(drives):
            return PhaseResult("failed", "stop_input")
        if drives.state == "fault":
            return PhaseResult("failed", f"drive_fault: {drives.cause}")
        if attempt.armed and drives.state == "stopped" and drives.epoch == self._epoch:
            return self._passing(f"gate_stop: {drives.cause}", inputs.now_ns)
        if attempt.enabled and not attempt.obeyed(drives):
            return PhaseResult("failed", f"drives_disarmed: {drives.cause or 'by themselves'}")
        if attempt.armed and inputs.arms is not None and inputs.arms.cause != "ok":
            # the arms already yield, the drives then hold their position
            return PhaseResult("failed", inputs.arms.cause)
        early = attempt.trolley == 1 and self._phase in ("approach", "insert", "push")
        if early and inputs.leader is not None and inputs.leader.lock == "locked":
            return PhaseResult("failed", "lock_implausible")
        return None

    def _passing(self, cause: str, now_ns: int) -> PhaseResult:
        """S1: disarmed. While nothing is in contact and the cause may pass, re-arm once all is well, a few times."""
        again = cause_code(cause.removeprefix("gate_stop: ")) in REARMING_CAUSES and self._attempt.may_rearm(now_ns)
        return PhaseResult("late") if again and self._phase in FREE else PhaseResult("failed", cause)

    def _follow(self, result: PhaseResult, inputs: SupervisorInputs) -> None:
        """Follow the table of transitions."""
        event: Event = result.event
        self._phase = next_phase(self._phase, event)
        attempt = self._attempt
        if event == "late":
            attempt.rearmed_ns.append(inputs.now_ns)
            self._epoch += 1
            attempt.epoch = self._epoch
        if event == "late" or self._phase in ENDED:
            attempt.armed = attempt.enabled = False
        if event in ("start", "reset", "failed", "abort"):
            self._cause = result.cause
        logic = _LOGIC.get(self._phase)
        self._logic = logic(attempt, inputs.now_ns) if logic is not None else None

    # --- outputs

    def _mission(self, wanted: PhaseOutputs) -> Mission:
        attempt = self._attempt
        return Mission(
            phase=self._phase,
            cause=self._cause[:400],
            trolley=attempt.trolley,
            epoch=self._epoch,
            armed=attempt.armed,
            motion=wanted.motion if attempt.armed else "hold",
            straight_speed_m_s=wanted.straight_speed_m_s,
            v_max_m_s=wanted.v_max_m_s,
            w_max_rad_s=wanted.w_max_rad_s,
            goal_theta_rad=attempt.goal.theta_rad,
            desired_features=tuple((float(a), float(b)) for a, b in attempt.desired),
            grip=attempt.grip,
            contact_expected=wanted.contact_expected,
            resets=self._resets,
            waiting=wanted.waiting[:400],
            needs_reset=self._latched(),
            turn_rate_rad_s=wanted.turn_rate_rad_s,
        )

    def _summary(self, inputs: SupervisorInputs, wanted: PhaseOutputs) -> FollowerSummary:
        """Careful: what is unknown counts as moving and as in contact."""
        attempt = self._attempt
        still = inputs.drives is not None and self._standstill.holds
        held = inputs.arms is None or not inputs.arms.released
        return FollowerSummary(
            phase=self._phase,
            cause=self._cause[:400],
            waiting=wanted.waiting[:400],
            trolley=attempt.trolley,
            armed=attempt.armed,
            moving=not still or (attempt.armed and wanted.motion != "hold"),
            in_contact=held and (self._phase in IN_CONTACT or self._apart is not True),
            gripped=inputs.arms is not None and inputs.arms.gripped,
            needs_reset=self._latched(),
        )
