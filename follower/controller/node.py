"""Controller process: docking state → command, on every third state, or sooner where states come late."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from common.channels import COMMAND, DOCKING_STATE, DRIVES, MISSION
from common.kinematics import twist_from_wheels
from common.messages import Command, DockingState, seal_command
from common.node import Inbox, Node, NodeContext, Output, Trigger
from common.timing import NS_PER_MS, NS_PER_S
from follower.controller.docking import DockingController, Twist
from follower.controller.methods import make_method
from follower.model.taught import taught_robots

STATES_PER_COMMAND = 3
# states that come late are not waited for until there are three: the next one is used, or none, before the gate finds
# the last command too old, also where this process comes 20 ms late: a gap pauses, it does not disarm
_LATE_NS, _GAP_NS = 60 * NS_PER_MS, 75 * NS_PER_MS
_log = logging.getLogger("follower-controller")


class ControllerNode(Node):
    """Keeps the paper's node synchronisation: 60 Hz states, 20 Hz commands, each from its state."""

    name = "follower-controller"
    inputs = (DOCKING_STATE, MISSION, DRIVES)
    outputs = (COMMAND,)
    trigger = Trigger(period_ns=NS_PER_S // 50, wakes=(DOCKING_STATE,))

    def __init__(self, context: NodeContext) -> None:
        self._clock = context.clock
        self._base = context.config.base
        config = taught_robots(context.config, context.config_path)
        self._method = make_method(config)
        self._controller = DockingController(config, self._method)
        self._deadline_ns = round(context.config.controller.deadline_ms * NS_PER_MS)
        self._last_stepped = -STATES_PER_COMMAND
        self._sequence = 0
        self._commanded_ns = 0

    def start(self, now_ns: int) -> None:  # noqa: ARG002 - the contract's signature
        """Solve once before anything can be armed: the first solve takes many times the later ones."""
        self._method.warm_up()

    def step(self, now_ns: int, inputs: Inbox) -> Sequence[Output]:
        """A command on every third state, or where they are late; none if the solve took too long."""
        received = inputs.newest(DOCKING_STATE)
        if received is None:
            return ()
        number = received.header.sequence
        since_ns = now_ns - self._commanded_ns
        due = inputs.arrived(DOCKING_STATE) is not None and (
            since_ns >= _LATE_NS or not 0 <= number - self._last_stepped < STATES_PER_COMMAND
        )
        drives = inputs.fresh(DRIVES, now_ns)
        wheels = twist_from_wheels(self._base, drives.wheel_speed_rad_s) if drives else None
        if inputs.arrived(DOCKING_STATE) is not None:
            self._controller.observe(received.message, wheels)
        if not due and since_ns < _GAP_NS:
            return ()
        mission = inputs.newest(MISSION)
        if mission is not None and mission.message.phase == "manual":
            return ()  # the operator's station commands: the gate takes one writer
        self._last_stepped = number
        state = received.message if due else None
        twist = self._controller.step(now_ns, state, inputs.fresh(MISSION, now_ns), wheels)
        done_ns = self._clock.now_ns()
        if done_ns - now_ns > self._deadline_ns:
            _log.warning("a solve of %.0f ms is dropped", (done_ns - now_ns) / NS_PER_MS)
            return ()
        self._controller.commit(twist)
        self._commanded_ns = done_ns
        epoch = mission.message.epoch if mission else 0
        return ((COMMAND, self._command(twist, epoch, received.message, done_ns)),)

    def _command(self, twist: Twist, epoch: int, state: DockingState, now_ns: int) -> Command:
        self._sequence += 1
        command = Command(
            v_m_s=twist.v_m_s,
            w_rad_s=twist.w_rad_s,
            epoch=epoch,
            sequence=self._sequence,
            stamp_ns=now_ns,
            valid_until_ns=now_ns + COMMAND.max_age_ns,
            frame_sequence=state.frame_sequence,
            capture_ns=state.capture_ns,
        )
        return seal_command(command)


def make(context: NodeContext) -> ControllerNode:
    """The controller process with the configured method."""
    return ControllerNode(context)
