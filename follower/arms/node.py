"""Arms process: joint torques that hold the handle; contact from joint torques."""

from __future__ import annotations

from collections.abc import Sequence

from common.channels import ARM_SETPOINT, ARM_STATE, DRIVES, MISSION
from common.node import Inbox, Node, NodeContext, Output, Trigger
from follower.arms.handle import HandleHold
from follower.arms.kinematics import check_postures


class ArmsNode(Node):
    """Steps with each message of the drives."""

    name = "follower-arms"
    inputs = (DRIVES, MISSION)
    outputs = (ARM_SETPOINT, ARM_STATE)
    trigger = Trigger(wakes=(DRIVES,))

    def __init__(self, context: NodeContext) -> None:
        config = context.config
        check_postures(config.arms, str(context.config_path))
        self._handle = HandleHold(config.arms, config.base)

    def step(self, now_ns: int, inputs: Inbox) -> Sequence[Output]:
        """Measure always; hold only while there is a mission, or the base still brakes after one."""
        drives = inputs.arrived(DRIVES)
        if drives is None:
            return ()
        mission, newest = inputs.fresh(MISSION, now_ns), inputs.newest(MISSION)
        outputs: list[Output] = [(ARM_STATE, self._handle.feel(drives, mission))]
        if mission is None and newest is not None and self._handle.led:
            mission = newest.message
        if mission is not None:
            outputs.append((ARM_SETPOINT, self._handle.hold(drives, mission)))
        return outputs


def make(context: NodeContext) -> ArmsNode:
    """The arms process."""
    return ArmsNode(context)
