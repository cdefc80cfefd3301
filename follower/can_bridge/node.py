"""CAN bridge process: command → gate → CAN; CAN → drives."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from common.channels import ARM_SETPOINT, COMMAND, DRIVES, MISSION
from common.errors import DeviceError
from common.messages import Drives
from common.node import Inbox, Node, NodeContext, Output, Trigger
from common.timing import NS_PER_S
from follower.can_bridge.bridge import Bridge, BridgeInputs, BridgeOutputs
from follower.can_bridge.drive_bus import DriveBus
from follower.can_bridge.gate import Decision, StampedCommand
from follower.can_bridge.measurement import BusMeasurement, DriveSetpoint
from follower.can_bridge.shadow import Shadow

_REOPEN_NS = NS_PER_S
_SHADOW_LOG_NS = NS_PER_S
_log = logging.getLogger("follower-can-bridge")


class CanBridgeNode(Node):
    """One exchange with the bus every 10 ms, and one at once for each new command.

    With ``follower_can.readonly`` it sends nothing, ignores the mission, and reports what another master's drives do.
    """

    name = "follower-can-bridge"
    inputs = (COMMAND, MISSION, ARM_SETPOINT)
    outputs = (DRIVES,)
    trigger = Trigger(period_ns=NS_PER_S // 100, wakes=(COMMAND,))

    def __init__(self, context: NodeContext) -> None:
        config = context.config
        self._clock = context.clock
        self._readonly = config.follower_can.readonly
        bus = DriveBus(
            config.follower_can,
            config.base,
            context.config_path,
            listen_only=self._readonly,
            clock_ns=context.clock.now_ns,
        )
        self._bus = context.device("drives", bus)
        self._bridge = Bridge(config, context.clock.boot_id)
        self._shadow = Shadow(config.follower_can, config.base) if config.follower_can.shadow else None
        self._logged_ns = 0
        self._measured: BusMeasurement | None = None
        self._sequence = -1
        self._image_to_can_ns = 0
        self._reopen_ns = 0
        self._state = self._stalled = ""
        self._warned = False

    def start(self, now_ns: int) -> None:  # noqa: ARG002 - the contract's signature
        """Bring every node up, disabled."""
        self._bus.open()

    def step(self, now_ns: int, inputs: Inbox) -> Sequence[Output]:
        """Gate, exchange, report."""
        if self._measured is None:
            self._measured = self._bus.exchange(now_ns, DriveSetpoint())
            return ()
        if not self._measured.bus_ok and now_ns >= self._reopen_ns:
            self._reopen(now_ns)
        command = inputs.newest(COMMAND)
        stamped = None
        if command is not None:
            header = command.header
            stamped = StampedCommand(command=command.message, run_id=header.run_id, boot_id=header.boot_id)
        newest = BridgeInputs(
            now_ns=now_ns,
            command=stamped,
            mission=None if self._readonly else inputs.newest(MISSION),
            arms=inputs.newest(ARM_SETPOINT),
        )
        judged = self._measured
        outputs, setpoint = self._decide(newest, judged)
        self._request(outputs)
        self._measured = self._bus.exchange(now_ns, setpoint)
        if self._measured.stalled != self._stalled:
            self._stalled = self._measured.stalled
            _log.warning("%s", self._stalled or "the stall is over: the drives may be enabled again")
        self._warn_without_sync(self._measured)
        self._time(outputs.decision, stamped)
        if self._bridge.state != self._state:
            self._state = self._bridge.state
            _log.info("%s %s", self._state, self._bridge.cause)
        return ((DRIVES, self._drives(self._measured, judged, outputs.decision)),)

    def stop(self, now_ns: int) -> Sequence[Output]:  # noqa: ARG002
        """Quick-stop and disable, in order; also after a fault of this process."""
        self._bus.close()
        return ()

    def _decide(self, inputs: BridgeInputs, measured: BusMeasurement) -> tuple[BridgeOutputs, DriveSetpoint]:
        """The bridge's outputs, and the set-point that is really sent."""
        if self._shadow is None:
            outputs = self._bridge.step(inputs, measured)
            return outputs, outputs.setpoint
        outputs = self._bridge.step(inputs, self._shadow.pretend(measured))
        if self._bridge.state == "armed" and inputs.now_ns - self._logged_ns >= _SHADOW_LOG_NS:
            self._logged_ns = inputs.now_ns
            v, w, rule = outputs.decision.v_m_s, outputs.decision.w_rad_s, outputs.decision.rule
            _log.info("shadow: would command v %+.3f m/s, ω %+.3f rad/s %s", v, w, rule)
        return outputs, self._shadow.withhold(outputs.setpoint)

    def _request(self, outputs: BridgeOutputs) -> None:
        if outputs.power == "enable":
            self._bus.enable()
        elif outputs.power == "stop_arms":
            self._bus.quick_stop(("arms",))
        elif outputs.power == "disable":
            self._bus.disable()
        elif outputs.power == "reset":
            _log.info("acknowledging drive faults on the operator's request")
            self._bus.reset_faults()

    def _warn_without_sync(self, measured: BusMeasurement) -> None:
        """Once: a listener receives drives' answers only where another master sends SYNC."""
        missing = self._readonly and measured.bus_ok and measured.measured_ns < 0
        if missing and not self._warned:
            _log.warning(
                "read only: no SYNC received yet: drives answer only where another master is active on the bus"
            )
        self._warned = self._warned or missing

    def _reopen(self, now_ns: int) -> None:
        """After a lost bus: bring everything up again, disabled."""
        self._reopen_ns = now_ns + _REOPEN_NS
        try:
            self._bus.open()
        except DeviceError as error:
            _log.warning("%s", error)

    def _time(self, decision: Decision, command: StampedCommand | None) -> None:
        """Measure from the image's capture to the first frame of its command on the bus."""
        if command is not None and decision.sequence != self._sequence and decision.sequence >= 0:
            self._sequence = decision.sequence
            self._image_to_can_ns = max(0, self._clock.now_ns() - command.command.capture_ns)

    def _drives(self, measured: BusMeasurement, judged: BusMeasurement, decision: Decision) -> Drives:
        """The newest measurement; but stop inputs as the state was decided on, so that the two never contradict."""
        bridge = self._bridge
        return Drives(
            state=bridge.state,
            cause=bridge.cause[:400],
            epoch=bridge.epoch,
            measured_ns=max(0, measured.measured_ns),
            wheel_speed_rad_s=measured.wheel_speed_rad_s,
            wheel_angle_rad=measured.wheel_angle_rad,
            joint_torque_n_m=measured.joint_torque_n_m,
            joint_angle_rad=measured.joint_angle_rad,
            grip_torque_n_m=measured.grip_torque_n_m,
            grip_angle_rad=measured.grip_angle_rad,
            lift_m=measured.lift_m,
            stop_inputs_clear=judged.inputs_fresh and judged.estop_clear and judged.protective_clear,
            battery_v=measured.battery_v,
            v_set_m_s=decision.v_m_s,
            w_set_rad_s=decision.w_rad_s,
            command_sequence=max(0, self._sequence),
            image_to_can_ns=self._image_to_can_ns,
            gate_interventions=bridge.interventions,
            gate_intervened=",".join(bridge.intervened),
            shadow=self._shadow is not None or self._readonly,
        )


def make(context: NodeContext) -> CanBridgeNode:
    """The Follower's CAN bridge."""
    return CanBridgeNode(context)
