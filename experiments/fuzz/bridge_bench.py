"""The bridge as a node on a simulated bus, armed again whenever something stopped it, and its limits."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from random import Random

from common.canopen.frames import CanFrame
from common.ceilings import HARD_WHEEL_SPEED_M_S, PHASE_CAPS
from common.channels import ARM_SETPOINT, COMMAND, MISSION
from common.config import Config, default_config_path
from common.messages import PHASES, ArmSetpoint, Command, Mission, Phase, seal_command
from common.node import Inbox, NodeContext, Outbox
from common.timing import NS_PER_MS, SteppedClock
from experiments.fuzz.can_bench import CanBench
from experiments.fuzz.messages import Mutator
from follower.can_bridge.node import CanBridgeNode
from sim.can.nodes import FollowerBus
from sim.can.stepped_bus import SteppedChannel

_CYCLE_NS, _WORLD_NS = 10 * NS_PER_MS, 2 * NS_PER_MS
_DISARMED_CYCLES = 140
_STOPPED_CYCLES = 130  # at rest from any speed, at the gate's ramp: 0.6 m/s at 0.5 m/s²
_ARMED_CYCLES = 400
_CALM_CYCLES = (5, 30, 100)
_SPARE_M_S = 0.002  # a set-point is a whole number of encoder counts
_MOST_TORQUE = 1000  # per mille of the rated torque
_LISTENED_CYCLES = 20


class BridgeBench(CanBench):
    """Missions and commands, mostly valid, around the frames that :meth:`step` adds to the bus."""

    _node: CanBridgeNode

    def __init__(self, config: Config, random: Random, folder: Path) -> None:
        stepped = config.follower_can.bus.model_copy(update={"interface": "stepped", "channel": "fuzz-follower"})
        can = config.follower_can.model_copy(update={"bus": stepped})
        self._config = config.model_copy(update={"follower_can": can})
        self._random = random
        clock = SteppedClock()
        path = default_config_path()
        self._robot = FollowerBus.build(can, path)
        channel = SteppedChannel("fuzz-follower", self._robot.bus, clock.now_ns)
        node = CanBridgeNode(NodeContext(self._config, path, folder, 1, clock))
        super().__init__(node, channel, clock, _LISTENED_CYCLES)
        self._inbox = Inbox(self._clock.boot_id)
        self._supervisor = Outbox("follower-supervisor", 1, self._clock.boot_id)
        self._mutator = Mutator(random, self._clock.boot_id)
        self._angles = [0.0, 0.0]
        self._phase: Phase = "approach"
        self._epoch = self._sequence = 1
        self._resets = 0
        self._armed_cycles, self._calm_cycles = 0, 0
        self._disarmed_cycles = 1
        self.moving_cycles = 0

    @property
    def ready(self) -> bool:
        """Whether it has been armed for long enough to drive."""
        return self._armed_cycles > self._calm_cycles and not self._disarmed_cycles

    def step(self, frames: Sequence[CanFrame]) -> str:
        """See :class:`CanBench`."""
        self._robot.bus.faults.injected += frames
        self._arm()
        self._send()
        self._inbox.begin_step()
        try:
            self._node.step(self._clock.now_ns(), self._inbox)
        finally:
            self._pass_time()
        return self._broken()

    def _arm(self) -> None:
        """As supervisor and operator: disarm after a stop, reset, and arm under a new epoch."""
        if self._disarmed_cycles:
            self._disarmed_cycles += 1
            if self._disarmed_cycles > _DISARMED_CYCLES:
                self._disarmed_cycles, self._armed_cycles = 0, 0
                self._epoch += 1
                self._calm_cycles = self._random.choice(_CALM_CYCLES)
                self._phase = "approach" if self._random.random() < 0.6 else self._random.choice(PHASES)
            return
        self._armed_cycles += 1
        if self._node._bridge.state in ("stopped", "fault") or self._armed_cycles > _ARMED_CYCLES:
            self._disarmed_cycles = 1
            self._resets += 1

    def _send(self) -> None:
        now_ns, random, put = self._clock.now_ns(), self._random, self._inbox.put_state
        self._sequence += 1
        mission = Mission(
            phase=self._phase,
            cause="",
            trolley=1,
            epoch=self._epoch,
            armed=not self._disarmed_cycles,
            motion="servo",
            straight_speed_m_s=0.0,
            v_max_m_s=1.0,
            w_max_rad_s=2.0,
            goal_theta_rad=0.0,
            desired_features=(),
            grip="closed",
            contact_expected=False,
            resets=self._resets,
        )
        v, w = (0.5, 0.3) if random.random() < 0.9 else (random.uniform(-10, 10), random.uniform(-10, 10))
        until_ns = now_ns + 120 * NS_PER_MS
        command = Command(v, w, self._epoch, self._sequence, now_ns, until_ns, self._sequence, now_ns)
        torque = random.choice((5.0, 5.0, 5.0, -1000.0, 1000.0))
        arms = ArmSetpoint(self._epoch, (torque,) * 6, (torque, torque), random.choice((0.2, 0.2, 2.0)))
        for channel, message in ((MISSION, mission), (COMMAND, seal_command(command)), (ARM_SETPOINT, arms)):
            put(channel, self._supervisor.pack(channel, message, now_ns), now_ns)
        if random.random() < 0.02:
            channel = random.choice((COMMAND, ARM_SETPOINT))
            put(channel, self._mutator.payload(channel, now_ns), now_ns)

    def _pass_time(self) -> None:
        end_ns = self._clock.now_ns() + _CYCLE_NS
        while self._clock.now_ns() < end_ns:
            self._clock.advance_to(self._clock.now_ns() + _WORLD_NS)
            for drive in self._robot.drives:
                drive.advance(self._clock.now_ns())
            for n, wheel in enumerate((self._robot.left_wheel, self._robot.right_wheel)):
                speed = wheel.velocity_setpoint_rad_s
                self._angles[n] += speed * 0.002
                wheel.set_measured(self._angles[n], speed, 0.1 * speed)
            self._channel.tick()

    def _broken(self) -> str:
        """The drives' set-points against the ceilings of this code, the phase's, and rest while disarmed."""
        robot, radius = self._robot, self._config.base.wheel_radius_m
        fastest = max(abs(each.velocity_setpoint_rad_s) * radius for each in (robot.left_wheel, robot.right_wheel))
        self.moving_cycles += fastest > 0.0
        if fastest > HARD_WHEEL_SPEED_M_S + _SPARE_M_S:
            return f"wheel beyond its ceiling: {fastest:.3f} m/s"
        if not self._disarmed_cycles and fastest > PHASE_CAPS[self._phase].wheel_m_s + _SPARE_M_S:
            return f"wheel beyond the cap of {self._phase}: {fastest:.3f} m/s"
        if self._disarmed_cycles > _STOPPED_CYCLES and fastest > 0.0:
            return f"speed while disarmed: {fastest:.3f} m/s"
        if any(abs(joint.values[0x6071, 0]) > _MOST_TORQUE for joint in robot.joints):
            return "joint torque beyond its ceiling"
        return ""
