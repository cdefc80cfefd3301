"""Supervisor process: phases of a docking, arming."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace

from common.channels import (
    ARM_STATE,
    COMMAND,
    DOCK_REQUEST,
    DOCKING_STATE,
    DRIVES,
    FOLLOWER_SUMMARY,
    FRAME,
    LEADER_STATE,
    LOCK_REQUEST,
    MANUAL_REQUEST,
    MISSION,
)
from common.file_writer import state_directory
from common.messages import FollowerSummary, Mission
from common.node import Inbox, Node, NodeContext, Output, Trigger
from common.timing import NS_PER_S
from follower.supervisor.attempt import undervoltage
from follower.supervisor.attempt_report import AttemptReport
from follower.supervisor.interface import SupervisorInputs
from follower.supervisor.journal import Journal
from follower.supervisor.manual import ManualInputs, ManualMode
from follower.supervisor.run_watch import RunWatch
from follower.supervisor.sequence import DockingSequence
from follower.supervisor.taught import taught_images

_STEPS_PER_SUMMARY = 2
_log = logging.getLogger("follower-supervisor")


class SupervisorNode(Node):
    """Shows the sequence what is fresh, publishes what it decides."""

    name = "follower-supervisor"
    inputs = (DOCKING_STATE, DRIVES, ARM_STATE, LEADER_STATE, COMMAND, FRAME)
    outputs = (MISSION, FOLLOWER_SUMMARY, LOCK_REQUEST)
    serves = (DOCK_REQUEST, MANUAL_REQUEST)
    trigger = Trigger(period_ns=NS_PER_S // 20)

    def __init__(self, context: NodeContext) -> None:
        """Read the taught images, if the configuration names any.

        Raises:
            ConfigError: they are missing or of another calibration.
        """
        taught = taught_images(context.config, context.config_path)
        self._sequence = DockingSequence(context.config, context.run_id, taught)
        self._base = context.config.base
        self._manual = ManualMode(context.config, context.run_id)
        self._phase = self._sequence.phase
        self._steps = 0
        self._report = AttemptReport(context.config)
        self._journal = Journal(state_directory(context.config.state_directory, context.runtime))
        self._runs = RunWatch()

    def step(self, now_ns: int, inputs: Inbox) -> Sequence[Output]:
        """One step of the sequence, or of the manual mode while that is on."""
        by_hand = self._manual.step(self._seen_by_hand(now_ns, inputs))
        seen = SupervisorInputs(
            now_ns=now_ns,
            state=inputs.fresh(DOCKING_STATE, now_ns),
            drives=inputs.fresh(DRIVES, now_ns),
            arms=inputs.fresh(ARM_STATE, now_ns),
            leader=inputs.fresh(LEADER_STATE, now_ns),
            controller_alive=inputs.fresh(COMMAND, now_ns) is not None,
            requests=by_hand.dock_requests,
            lock_answers=tuple(inputs.answers(LOCK_REQUEST)),
            restarted=self._runs.restarted(inputs),
            unfit=self._journal.unfit(now_ns) or undervoltage(self._base, inputs.fresh(DRIVES, now_ns)),
        )
        decided = self._sequence.step(seen)
        self._journal.keep(self._report.step(seen, decided.mission, self._sequence.attempt))
        mission = self._manual.mission(decided.mission)
        if mission.phase != self._phase:
            self._phase = mission.phase
            _log.info("phase %s %s", self._phase, mission.cause)
        outputs: list[Output] = [(MISSION, mission)]
        self._steps += 1
        if self._steps % _STEPS_PER_SUMMARY == 0:
            outputs.append((FOLLOWER_SUMMARY, _by_hand(decided.summary, mission)))
        outputs += [(DOCK_REQUEST, answer) for answer in (*by_hand.dock_answers, *decided.answers)]
        outputs += [(MANUAL_REQUEST, answer) for answer in by_hand.answers]
        if decided.lock_request is not None:
            outputs.append((LOCK_REQUEST, decided.lock_request))
        return outputs

    def stop(self, now_ns: int) -> Sequence[Output]:  # noqa: ARG002 - the contract's signature
        """Write what still waits."""
        self._journal.close()
        return ()

    def _seen_by_hand(self, now_ns: int, inputs: Inbox) -> ManualInputs:
        return ManualInputs(
            now_ns=now_ns,
            phase=self._sequence.phase,
            drives=inputs.fresh(DRIVES, now_ns),
            arms=inputs.fresh(ARM_STATE, now_ns),
            command=inputs.fresh(COMMAND, now_ns),
            requests=tuple(received.message for received in inputs.requests(MANUAL_REQUEST)),
            dock_requests=tuple(received.message for received in inputs.requests(DOCK_REQUEST)),
        )


def _by_hand(summary: FollowerSummary, mission: Mission) -> FollowerSummary:
    """The docking's summary; while a person moves the robot it may move at any time."""
    if mission.phase != "manual":
        return summary
    return replace(summary, phase=mission.phase, armed=True, moving=True)


def make(context: NodeContext) -> SupervisorNode:
    """The supervisor process."""
    return SupervisorNode(context)
