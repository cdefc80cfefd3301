"""A Follower that drives through gate and bus, wheels up, in stepped time."""

from __future__ import annotations

import pytest

from common.kinematics import wheels_from_twist
from common.messages import Command, seal_command
from common.timing import NS_PER_MS
from follower.can_bridge.gate import ArmToken, Decision, Gate, StampedCommand
from follower.can_bridge.measurement import BusMeasurement, DriveSetpoint
from tests.rigs.canbus_rig import Rig, Tap, is_stop, stop_inputs, wheels_alone


class Driving:
    """A Follower under way through the gate, at 0.3 m/s unless given another speed, and a tap on its bus."""

    def __init__(self, rig: Rig, speed_m_s: float = 0.3, turn_rad_s: float = 0.0) -> None:
        self.rig = rig
        self.speed_m_s, self.turn_rad_s = speed_m_s, turn_rad_s
        self.tap = Tap(rig)
        self.gate = Gate(rig.config.limits, rig.config.base, "boot")
        self.sequence = 0
        self.measured = rig.enable()
        for _ in range(100):
            self.decision = self.step()
        assert self.measured.troubles == ()
        assert (self.decision.v_m_s, self.decision.w_rad_s) == (speed_m_s, turn_rad_s)
        self.tap.read()

    def step(self) -> Decision:
        """Gate, exchange, 10 ms."""
        now_ns, measured, base = self.rig.clock.now_ns(), self.measured, self.rig.config.base
        self.sequence += 1
        command = seal_command(
            Command(self.speed_m_s, self.turn_rad_s, 1, self.sequence, now_ns, now_ns + 120 * NS_PER_MS, 1, now_ns)
        )
        self.decision = self.gate.step(
            now_ns,
            StampedCommand(command=command, run_id=1, boot_id="boot"),
            ArmToken(
                armed=True, stamp_ns=now_ns, boot_id="boot", epoch=1, phase="approach", v_max_m_s=0.5, w_max_rad_s=0.6
            ),
            wheels_alone(measured),
            stop_inputs(measured),
        )
        left, right = wheels_from_twist(base, self.decision.v_m_s, self.decision.w_rad_s)
        self.measured = self.rig.cycle(DriveSetpoint(left_rad_s=left, right_rad_s=right))
        return self.decision

    def stop_ms(self, within: int = 30) -> tuple[float, BusMeasurement]:
        """Time from now to the first frames that stop both wheels; the measurement that came with them."""
        start_ns = self.rig.clock.now_ns()
        ids = (self.rig.robot.left_wheel.node_id, self.rig.robot.right_wheel.node_id)
        for _ in range(within):
            sent_ns = self.rig.clock.now_ns()
            self.step()
            frames = [frame for _, frame in self.tap.read()]
            if all(any(is_stop(frame, node_id) for frame in frames) for node_id in ids):
                return (sent_ns - start_ns) / NS_PER_MS, self.measured
        pytest.fail("the wheels were not stopped")
