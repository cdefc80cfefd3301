"""Supervisor process: phases of a docking, manual mode, arming."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime

from common.channels import (
    ARM_STATE,
    COMMAND,
    DOCK_REQUEST,
    DOCKING_STATE,
    DRIVES,
    FOLLOWER_GATEWAY,
    FOLLOWER_SUMMARY,
    FRAME,
    LEADER_STATE,
    LOCK_REQUEST,
    MANUAL_REQUEST,
    MISSION,
)
from common.files.writer import state_directory
from common.messages import DockRequest, FollowerSummary, Mission
from common.node import Inbox, Node, NodeContext, Output, Trigger
from common.timing import NS_PER_S
from follower.model.taught import taught_geometry
from follower.supervisor.attempt import undervoltage
from follower.supervisor.attempt_report import AttemptReport
from follower.supervisor.fitness import CalibrationWatch, certificate_unfit
from follower.supervisor.interface import SupervisorInputs
from follower.supervisor.journal import Journal
from follower.supervisor.late_watch import LateWatch
from follower.supervisor.manual import ManualInputs, ManualMode
from follower.supervisor.run_watch import RunWatch
from follower.supervisor.sequence import DockingSequence

_STEPS_PER_SUMMARY = 2
_TIMED = (DRIVES, ARM_STATE)  # of processes whose loops wait for no camera
_MALFORMED = 2  # in a row: one alone is dropped (docs/safety.md S14)
_log = logging.getLogger("follower-supervisor")


class SupervisorNode(Node):
    """Gives docking and manual mode their requests and fresh inputs; publishes their mission."""

    name = "follower-supervisor"
    inputs = (DOCKING_STATE, DRIVES, ARM_STATE, LEADER_STATE, COMMAND, FRAME, FOLLOWER_GATEWAY)
    outputs = (MISSION, FOLLOWER_SUMMARY, LOCK_REQUEST)
    serves = (DOCK_REQUEST, MANUAL_REQUEST)
    trigger = Trigger(period_ns=NS_PER_S // 20)

    def __init__(self, context: NodeContext) -> None:
        """Read the taught images, if the configuration names any.

        Raises:
            ConfigError: they are missing or of another calibration.
        """
        taught = taught_geometry(context.config, context.config_path)
        config = context.config if taught is None else taught.config
        self._sequence = DockingSequence(config, context.run_id, None if taught is None else taught.goals)
        self._base = context.config.base
        self._manual = ManualMode(context.config, context.run_id)
        self._phase = self._sequence.phase
        self._steps = 0
        self._report = AttemptReport(config)
        journal = Journal(state_directory(context.config.state_directory, context.runtime))
        self._journal = context.device("journal", journal)
        self._runs = RunWatch()
        self._late = LateWatch()
        calibration = CalibrationWatch(context.config.camera, context.config_path, datetime.now(UTC).date())
        self._calibration = context.device("calibration", calibration)

    def step(self, now_ns: int, inputs: Inbox) -> Sequence[Output]:
        """One step of the docking, and of the manual mode, whose mission comes first while it is on."""
        dock_requests, answers = self._split_requests(now_ns, inputs)
        supervisor_inputs = SupervisorInputs(
            now_ns=now_ns,
            state=inputs.fresh(DOCKING_STATE, now_ns),
            drives=inputs.fresh(DRIVES, now_ns),
            arms=inputs.fresh(ARM_STATE, now_ns),
            leader=inputs.fresh(LEADER_STATE, now_ns),
            controller_alive=inputs.fresh(COMMAND, now_ns) is not None,
            requests=dock_requests,
            lock_answers=tuple(inputs.answers(LOCK_REQUEST)),
            restarted=self._runs.restarted(inputs),
            unfit=self._unfit(now_ns, inputs),
            late=self._late.step(now_ns, {channel.publisher: inputs.late(channel) for channel in _TIMED}),
            malformed=_malformed(inputs),
        )
        docking = self._sequence.step(supervisor_inputs)
        self._journal.keep(self._report.step(supervisor_inputs, docking.mission, self._sequence.attempt))
        mission = self._manual.mission(docking.mission)
        if mission.phase != self._phase:
            self._phase = mission.phase
            _log.info("phase %s %s", self._phase, mission.cause)
        outputs: list[Output] = [(MISSION, mission)]
        self._steps += 1
        if self._steps % _STEPS_PER_SUMMARY == 0:
            outputs.append((FOLLOWER_SUMMARY, _summary(docking.summary, mission)))
        outputs += answers
        outputs += [(DOCK_REQUEST, answer) for answer in docking.answers]
        if docking.lock_request is not None:
            outputs.append((LOCK_REQUEST, docking.lock_request))
        return outputs

    def stop(self, now_ns: int) -> Sequence[Output]:  # noqa: ARG002 - the contract's signature
        """Write what is still queued."""
        self._journal.close()
        return ()

    def _unfit(self, now_ns: int, inputs: Inbox) -> str:
        """Why no docking may begin although nothing is broken; empty if one may."""
        frame = inputs.newest(FRAME)
        return (
            self._journal.unfit(now_ns)
            or undervoltage(self._base, inputs.fresh(DRIVES, now_ns))
            or self._calibration.unfit(frame.message.camera_id if frame is not None else None)
            or certificate_unfit(inputs.fresh(FOLLOWER_GATEWAY, now_ns))
        )

    def _split_requests(self, now_ns: int, inputs: Inbox) -> tuple[tuple[DockRequest, ...], list[Output]]:
        """Step the manual mode with its own requests; it answers those for the docking only while it is on.

        Returns:
            The requests that are left for the docking, and the answers to the others.
        """
        manual = self._manual
        manual_inputs = ManualInputs(
            now_ns=now_ns,
            phase=self._sequence.phase,
            drives=inputs.fresh(DRIVES, now_ns),
            arms=inputs.fresh(ARM_STATE, now_ns),
            command=inputs.fresh(COMMAND, now_ns),
            requests=tuple(received.message for received in inputs.requests(MANUAL_REQUEST)),
        )
        answers: list[Output] = [(MANUAL_REQUEST, answer) for answer in manual.answer(manual_inputs)]
        docking: list[DockRequest] = []
        for received in inputs.requests(DOCK_REQUEST):
            if manual.active:
                answers.append((DOCK_REQUEST, manual.answer_docking(received.message)))
            else:
                docking.append(received.message)
        manual.watch(manual_inputs)
        return tuple(docking), answers


def _malformed(inputs: Inbox) -> str:
    """The process whose last messages could not be decoded, after they were looked at; empty: none."""
    channels = (DOCKING_STATE, DRIVES, ARM_STATE, COMMAND)
    return next((each.publisher for each in channels if inputs.malformed_in_a_row(each) >= _MALFORMED), "")


def _summary(summary: FollowerSummary, mission: Mission) -> FollowerSummary:
    """The summary of the docking; in manual mode the robot may move at any time."""
    if mission.phase != "manual":
        return summary
    return replace(summary, phase=mission.phase, armed=True, moving=True)


def make(context: NodeContext) -> SupervisorNode:
    """The supervisor process."""
    return SupervisorNode(context)
