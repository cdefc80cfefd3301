"""CAN bridge process: command → gate → CAN; CAN → drives."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from common.channels import ARM_SETPOINT, COMMAND, DRIVES, MISSION
from common.errors import DeviceError
from common.messages import Drives
from common.node import Inbox, Node, NodeContext, Output, Trigger
from common.timing import NS_PER_S
from follower.can_bridge.bridge import Bridge, Heard, Orders
from follower.can_bridge.drive_bus import DriveBus
from follower.can_bridge.gate import Decision, StampedCommand
from follower.can_bridge.measurement import DriveSetpoint, Measurement
from follower.can_bridge.shadow import Shadow

_REOPEN_NS = NS_PER_S
_TELL_NS = NS_PER_S
_log = logging.getLogger("follower-can-bridge")


class CanBridgeNode(Node):
    """One exchange with the bus every 10 ms, and one at once for each new command.

    With ``follower_can.readonly`` it sends nothing and hears no mission: it tells what another master's drives do.
    """

    name = "follower-can-bridge"
    inputs = (COMMAND, MISSION, ARM_SETPOINT)
    outputs = (DRIVES,)
    trigger = Trigger(period_ns=NS_PER_S // 100, wakes=(COMMAND,))

    def __init__(self, context: NodeContext) -> None:
        config = context.config
        self._clock = context.clock
        self._readonly = config.follower_can.readonly
        self._bus = DriveBus(
            config.follower_can,
            config.base,
            context.config_path,
            listen_only=self._readonly,
            clock_ns=context.clock.now_ns,
        )
        self._bridge = Bridge(config, context.clock.boot_id)
        self._shadow = Shadow(config.follower_can, config.base) if config.follower_can.shadow else None
        self._told_ns = 0
        self._measured: Measurement | None = None
        self._sequence = -1
        self._image_to_can_ns = 0
        self._reopen_ns = 0
        self._state = self._stalled = ""
        self._unheard = False

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
        stamped = StampedCommand(command.message, command.header.run_id, command.header.boot_id) if command else None
        mission = None if self._readonly else inputs.newest(MISSION)
        heard = Heard(now_ns, stamped, mission, inputs.newest(ARM_SETPOINT))
        orders, setpoint = self._decide(heard, self._measured)
        self._request(orders)
        self._measured = self._bus.exchange(now_ns, setpoint)
        if self._measured.stalled != self._stalled:
            self._stalled = self._measured.stalled
            _log.warning("%s", self._stalled or "the stall is over: the drives may be enabled anew")
        self._say_unheard(self._measured)
        self._time(orders.decision, stamped)
        if self._bridge.state != self._state:
            self._state = self._bridge.state
            _log.info("%s %s", self._state, self._bridge.cause)
        return ((DRIVES, self._drives(self._measured, orders.decision)),)

    def stop(self, now_ns: int) -> Sequence[Output]:  # noqa: ARG002
        """Quick-stop and disable, in order; also after a fault of this process."""
        self._bus.close()
        return ()

    def _decide(self, heard: Heard, measured: Measurement) -> tuple[Orders, DriveSetpoint]:
        """Orders, and the set-point that is really sent."""
        if self._shadow is None:
            orders = self._bridge.step(heard, measured)
            return orders, orders.setpoint
        orders = self._bridge.step(heard, self._shadow.pretend(measured))
        if self._bridge.state == "armed" and heard.now_ns - self._told_ns >= _TELL_NS:
            self._told_ns = heard.now_ns
            v, w, rule = orders.decision.v_m_s, orders.decision.w_rad_s, orders.decision.rule
            _log.info("shadow: would command v %+.3f m/s, ω %+.3f rad/s %s", v, w, rule)
        return orders, self._shadow.withhold(orders.setpoint)

    def _request(self, orders: Orders) -> None:
        if orders.power == "enable":
            self._bus.enable()
        elif orders.power == "stop_arms":
            self._bus.quick_stop(("arms",))
        elif orders.power == "disable":
            self._bus.disable()
        elif orders.power == "reset":
            _log.info("acknowledging drive faults, as a person asked")
            self._bus.reset_faults()

    def _say_unheard(self, measured: Measurement) -> None:
        """Said once: whoever only listens hears drives only where another master sends SYNC."""
        unheard = self._readonly and measured.bus_ok and measured.measured_ns < 0
        if unheard and not self._unheard:
            _log.warning("read only: no SYNC heard yet: drives answer only where another master works on the bus")
        self._unheard = self._unheard or unheard

    def _reopen(self, now_ns: int) -> None:
        """The way back after a lost bus: everything is brought up anew, disabled."""
        self._reopen_ns = now_ns + _REOPEN_NS
        try:
            self._bus.open()
        except DeviceError as error:
            _log.warning("%s", error)

    def _time(self, decision: Decision, command: StampedCommand | None) -> None:
        """From the image's capture to its command's first frame on the bus."""
        if command is not None and decision.sequence != self._sequence and decision.sequence >= 0:
            self._sequence = decision.sequence
            self._image_to_can_ns = max(0, self._clock.now_ns() - command.command.capture_ns)

    def _drives(self, measured: Measurement, decision: Decision) -> Drives:
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
            stop_inputs_clear=measured.inputs_fresh and measured.estop_clear and measured.protective_clear,
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
