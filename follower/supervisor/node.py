"""Supervisor process: phases of a docking, arming."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from common.channels import (
    ARM_STATE,
    COMMAND,
    DOCK_REQUEST,
    DOCKING_STATE,
    DRIVES,
    FOLLOWER_SUMMARY,
    LEADER_STATE,
    LOCK_REQUEST,
    MISSION,
)
from common.node import Inbox, Node, NodeContext, Output, Trigger
from common.timing import NS_PER_S
from follower.supervisor.observed import Observed
from follower.supervisor.sequence import DockingSequence
from follower.supervisor.taught import taught_images

_STEPS_PER_SUMMARY = 2
_log = logging.getLogger("follower-supervisor")


class SupervisorNode(Node):
    """Shows the sequence what is fresh, publishes what it decides."""

    name = "follower-supervisor"
    inputs = (DOCKING_STATE, DRIVES, ARM_STATE, LEADER_STATE, COMMAND)
    outputs = (MISSION, FOLLOWER_SUMMARY, LOCK_REQUEST)
    serves = (DOCK_REQUEST,)
    trigger = Trigger(period_ns=NS_PER_S // 20)

    def __init__(self, context: NodeContext) -> None:
        """Read the taught images, if the configuration names any.

        Raises:
            ConfigError: they are missing or of another calibration.
        """
        taught = taught_images(context.config, context.config_path)
        self._sequence = DockingSequence(context.config, context.run_id, taught)
        self._phase = self._sequence.phase
        self._steps = 0

    def step(self, now_ns: int, inputs: Inbox) -> Sequence[Output]:
        """One step of the sequence."""
        seen = Observed(
            now_ns=now_ns,
            state=inputs.fresh(DOCKING_STATE, now_ns),
            drives=inputs.fresh(DRIVES, now_ns),
            arms=inputs.fresh(ARM_STATE, now_ns),
            leader=inputs.fresh(LEADER_STATE, now_ns),
            controller_alive=inputs.fresh(COMMAND, now_ns) is not None,
            requests=tuple(received.message for received in inputs.requests(DOCK_REQUEST)),
            lock_answers=tuple(inputs.answers(LOCK_REQUEST)),
        )
        decided = self._sequence.step(seen)
        if self._sequence.phase != self._phase:
            self._phase = self._sequence.phase
            _log.info("phase %s %s", self._phase, decided.mission.cause)
        outputs: list[Output] = [(MISSION, decided.mission)]
        self._steps += 1
        if self._steps % _STEPS_PER_SUMMARY == 0:
            outputs.append((FOLLOWER_SUMMARY, decided.summary))
        outputs += [(DOCK_REQUEST, answer) for answer in decided.answers]
        if decided.lock_request is not None:
            outputs.append((LOCK_REQUEST, decided.lock_request))
        return outputs


def make(context: NodeContext) -> SupervisorNode:
    """The supervisor process."""
    return SupervisorNode(context)
