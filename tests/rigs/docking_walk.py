"""Random walks through the supervisor: a robot that mostly obeys, a world that mostly does not help."""

from __future__ import annotations

import random
from dataclasses import replace
from typing import Any

from common.causes import CAUSES, cause_code, needs_reset
from common.config import Config
from common.geometry import Pose2
from common.messages import Answer, ArmState, DockRequest, FollowerSummary, LockRequest, Mission
from common.timing import NS_PER_S
from follower.supervisor.attempt import MAX_PAUSES, MAX_REARMED, MAX_RETRIES, MAX_SEARCHES, REARMED_WITHIN_S
from follower.supervisor.interface import SupervisorInputs, SupervisorOutputs
from follower.supervisor.sequence import DockingSequence
from follower.supervisor.transitions import ACTIVE, ENDED, IN_CONTACT
from tests.rigs.supervisor_rig import ARMS, DRIVES, LEADER, docking_state

STEP_NS = NS_PER_S // 20
RELEASED = ArmState(0.0, False, False, False, True)
BACKWARDS = ("staging", "retract")
FORWARDS = ("insert", "push")
FAULTS = (
    *("leds",) * 4, "two_leds", "elsewhere", "lock", "stall", "estimator", "bridge", "arms", "link", "controller",
    "estop", "drives", "late", "slip", "contact", "connected", "gripped", "released", "rolls", "lags",
)  # fmt: skip
OPEN_ALLOWED = ("staging", "release", "retract", *ENDED)


class DockingWalk:
    """Feeds one sequence; :meth:`step` observes, decides and judges."""

    def __init__(self, config: Config, seed: int) -> None:
        self.config = config
        self.random = random.Random(seed)
        self.sequence = DockingSequence(config, 1000)
        self.pose = Pose2(3.0, 0.05, 0.0)
        self.rolled = [0.0, 0.0]
        self.arms = ARMS
        self.seen = SupervisorInputs(
            now_ns=NS_PER_S, state=None, drives=DRIVES, arms=ARMS, leader=LEADER, controller_alive=True
        )
        self.before: Mission | None = None
        self.armed_epochs: set[int] = set()
        self.ended_epochs: set[int] = set()
        self.lock_word: set[int] = set()
        self.phases: set[str] = set()
        self.latched = self.touched = False
        self.turned_ns = 0
        self.faults: dict[str, int] = {}
        self.asked: LockRequest | None = None

    def step(self) -> SupervisorOutputs:
        """One observation, chosen at random around what a robot would show."""
        seen = self._observe()
        for answer in seen.lock_answers:
            if self.asked is not None and answer.id == self.asked.id and answer.outcome == "done":
                self.lock_word.add(self.sequence.attempt.epoch)
        was_latched, began = self.latched, self.sequence.phase
        decided = self.sequence.step(seen)
        if decided.lock_request is not None:
            self.asked = decided.lock_request
            assert decided.mission.phase == "lock"
        if any(
            answer.outcome == "done"
            for request, answer in zip(seen.requests, decided.answers, strict=True)
            if request.action == "reset"
        ):
            was_latched = self.latched = False
        if began in IN_CONTACT:
            self.touched = True
        elif self._is_apart(seen):
            self.touched = False
        self._judge(seen, decided, was_latched)
        self.seen, self.before = seen, decided.mission
        return decided

    # --- the world

    def _observe(self) -> SupervisorInputs:
        draw = self.random.random
        self._begin_fault()
        self._move()
        fault = {name for name, left in self.faults.items() if left > 0}
        self.faults = {name: left - 1 for name, left in self.faults.items() if left > 1}
        state: Any = docking_state(self.config, self.pose, "leds" not in fault)
        if "leds" not in fault:
            state = replace(
                state,
                features=((0.0, 0.0),) * (2 if "two_leds" in fault else 4)
                + (None,) * (2 if "two_leds" in fault else 0),
            )
        if "elsewhere" in fault:
            state = replace(state, y_m=state.y_m + 3.0)
        leader: Any = replace(
            LEADER,
            lock="fault" if "lock" in fault else self._lock(),
            queue=self.sequence.attempt.trolley - 1,
        )
        return SupervisorInputs(
            now_ns=self.seen.now_ns + (STEP_NS if "stall" not in fault else 40 * STEP_NS),
            state=None if "estimator" in fault else state,
            drives=None if "bridge" in fault else self._drives(fault),
            arms=None if "arms" in fault else self._arms(fault),
            leader=None if "link" in fault else leader,
            controller_alive="controller" not in fault,
            requests=self._requests(),
            lock_answers=self._answers(),
            restarted="follower-arms" if draw() < 0.0003 else "",
            unfit="disk" if draw() < 0.01 else "",
        )

    def _lock(self) -> Any:
        later = self.sequence.attempt.trolley > 1
        return "locked" if later or (self.asked is not None and self.random.random() < 0.7) else "open"

    def _begin_fault(self) -> None:
        if self.random.random() < 0.008:
            duration = self.random.choice((1, 2, 5, 20, 80, 300))
            name = self.random.choice(FAULTS)
            if name == "leds":
                duration = self.random.choice((1, 5, 90, 300))
            self.faults[name] = 1 if name in ("estop", "drives", "late", "slip", "stall") else duration

    def _move(self) -> None:
        """As the mission says, or not at all, or somewhere else altogether."""
        mission = self.before
        if mission is None:
            return
        v, w = 0.0, 0.0
        if mission.motion == "straight":
            v = mission.straight_speed_m_s
        elif mission.motion == "turn":
            w = mission.turn_rate_rad_s
        elif mission.motion == "servo":
            goal = self.config.docking.goal(mission.trolley)
            v = max(-0.1, min(mission.v_max_m_s, self.pose.x_m - goal.x_m))
            self.pose = Pose2(self.pose.x_m, self.pose.y_m * 0.97, self.pose.theta_rad * 0.95)
        stuck = self.random.random() < 0.1
        self.pose = Pose2(self.pose.x_m - (0 if stuck else v / 20), self.pose.y_m, self.pose.theta_rad)
        base = self.config.base
        if "rolls" in self.faults:
            v += 0.05
        if v or w:
            self.turned_ns = self.seen.now_ns
        self.rolled[0] += (v - w * base.track_m / 2) / 20 / base.wheel_radius_m
        self.rolled[1] += (v + w * base.track_m / 2) / 20 / base.wheel_radius_m
        if mission.phase in ENDED and self.random.random() < 0.05:
            self.pose = Pose2(
                self.random.choice((1.2, 1.55, 1.6, 1.7, 2.3, 4.5)), self.random.uniform(-0.1, 0.1), 0.0
            )

    def _drives(self, fault: set[str]) -> Any:
        mission = self.before
        armed = mission is not None and mission.armed
        state: Any = "armed" if armed else "disarmed"
        cause = ""
        if "lags" in fault and armed:
            state = "enabling"
        if "late" in fault:
            state, cause = "stopped", self.random.choice(("command_age", "token_age", "second_writer"))
        if "drives" in fault:
            state, cause = self.random.choice((("fault", "EMCY"), ("disarmed", ""), ("stopped", "status_age")))
        epoch = mission.epoch if mission is not None else 0
        return replace(
            DRIVES,
            state=state,
            cause=cause,
            epoch=epoch,
            stop_inputs_clear="estop" not in fault,
            measured_ns=self.seen.now_ns + STEP_NS,
            wheel_angle_rad=(self.rolled[0], self.rolled[1]),
        )

    def _arms(self, fault: set[str]) -> ArmState:
        mission = self.before
        wanted_open = mission is not None and mission.grip == "open"
        if self.random.random() < 0.05:
            self.arms = RELEASED if wanted_open else ARMS
        goal_m = self.config.docking.goal(mission.trolley if mission else 1).x_m
        touching = self.pose.x_m < goal_m - 0.05 and mission is not None and mission.contact_expected
        return replace(
            self.arms,
            gripped=self.arms.gripped and "gripped" not in fault,
            released=self.arms.released and "released" not in fault,
            contact=touching or "contact" in fault,
            connected=(touching and self.pose.x_m < goal_m - 0.14)
            or ("connected" in fault and self.random.random() < 0.1),
            cause=self.random.choice(("slip", "collision")) if "slip" in fault else "ok",
        )

    def _requests(self) -> tuple[DockRequest, ...]:
        draw = self.random.random()
        expires_ns = self.seen.now_ns + NS_PER_S * (100 if draw < 0.06 else -1)
        if draw < 0.05:
            return (DockRequest("s", expires_ns, "start", self.random.choice((1, 1, 2))),)
        if draw < 0.0515:
            return (DockRequest("a", expires_ns, "abort"),)
        return (DockRequest("r", expires_ns, "reset"),) if draw < 0.07 else ()

    def _answers(self) -> tuple[Answer, ...]:
        if self.asked is None or self.random.random() > 0.1:
            return ()
        draw = self.random.random()
        outcome: Any = "done" if draw < 0.9 else self.random.choice(("refused", "expired"))
        return (Answer(self.asked.id if draw > 0.02 else "another", outcome, "said"),)

    # --- judging

    def _judge(self, seen: SupervisorInputs, decided: SupervisorOutputs, was_latched: bool) -> None:
        mission, summary = decided.mission, decided.summary
        self.phases.add(mission.phase)
        if mission.phase in ENDED:
            assert not mission.armed
            self.asked = None
        if mission.armed and not (self.before is not None and self.before.armed):
            # what was moved last was measured one step later
            assert seen.now_ns - self.turned_ns - STEP_NS >= NS_PER_S // 5
        self._judge_epochs(mission)
        self._judge_motion(seen, mission)
        self._judge_grip(seen, mission, summary)
        attempt = self.sequence.attempt
        of_late = [at for at in attempt.rearmed_ns if seen.now_ns - at < REARMED_WITHIN_S * NS_PER_S]
        assert len(of_late) <= MAX_REARMED
        assert attempt.searches <= MAX_SEARCHES
        assert attempt.retries <= MAX_RETRIES
        assert attempt.pauses <= MAX_PAUSES + 1
        if mission.phase == "aborted":
            assert cause_code(mission.cause) in CAUSES, mission.cause
            held = attempt.contact_begin_m is not None or self.touched
            assert mission.needs_reset == (held or needs_reset(mission.cause))
        if was_latched:
            assert mission.phase == "aborted"
        self.latched = mission.needs_reset

    def _judge_epochs(self, mission: Mission) -> None:
        """An epoch that was disarmed is never armed again."""
        assert self.before is None or mission.epoch >= self.before.epoch
        if mission.armed:
            assert mission.phase in ACTIVE
            assert mission.epoch not in self.ended_epochs
            self.armed_epochs.add(mission.epoch)
        elif mission.epoch in self.armed_epochs:
            self.ended_epochs.add(mission.epoch)

    def _judge_motion(self, seen: SupervisorInputs, mission: Mission) -> None:
        """Nothing moves but armed, with drives that are heard, obey and see no stop; ahead only with sight."""
        if mission.motion == "hold":
            assert (mission.straight_speed_m_s, mission.turn_rate_rad_s) == (0.0, 0.0)
            return
        assert mission.armed
        assert seen.drives is not None
        assert seen.drives.stop_inputs_clear
        assert seen.drives.state == "armed"
        assert seen.drives.epoch == mission.epoch
        assert not seen.restarted
        sighted = seen.state is not None and seen.state.valid
        if mission.motion == "servo":
            assert mission.phase == "approach"
            assert sighted
            limits = self.config.supervisor
            near = self.pose.x_m - self.config.docking.goal(mission.trolley).x_m <= 1.0
            assert mission.v_max_m_s <= (limits.last_metre_speed_m_s if near else limits.approach_speed_m_s)
        elif mission.motion == "turn":
            assert mission.phase == "search"
            assert mission.v_max_m_s == 0.0
        elif mission.straight_speed_m_s > 0.0:
            assert mission.phase in FORWARDS
            assert mission.straight_speed_m_s <= 0.05
            assert sighted
        else:
            assert mission.phase in BACKWARDS
            assert mission.straight_speed_m_s >= -0.1

    def _judge_grip(self, seen: SupervisorInputs, mission: Mission, summary: FollowerSummary) -> None:
        """Nothing in contact is let go before the Leader has said that it is locked."""
        if mission.grip == "open":
            assert mission.phase in OPEN_ALLOWED
        if mission.phase in ("release", "retract"):
            assert self.sequence.attempt.epoch in self.lock_word
        if mission.contact_expected:
            assert mission.phase in ("insert", "push", "lock")
            assert mission.grip == "closed"
        touches = self.touched or mission.phase in ("insert", "push", "lock")
        if touches and (seen.arms is None or not seen.arms.released):
            assert summary.in_contact
        if mission.motion != "hold" or seen.drives is None:
            assert summary.moving

    def _is_apart(self, seen: SupervisorInputs) -> bool:
        """The trolley was let go, or is by sight and odometry well before where the next one goes."""
        pose = self.sequence.attempt.reckoning.leader_in_follower
        if seen.arms is not None and seen.arms.released:
            return True
        if pose is None or seen.leader is None or seen.leader.queue is None:
            return False
        return pose.x_m > self.config.docking.goal(seen.leader.queue + 1).x_m + 0.3
