"""A bridge without a bus: its mission and measurement stay fresh while time goes on."""

from __future__ import annotations

from dataclasses import replace

from common.canopen.cia402 import DriveState
from common.config import Config
from common.messages import ArmSetpoint, Command, Header, Mission, seal_command
from common.node import Received
from common.timing import NS_PER_MS, NS_PER_S
from follower.can_bridge.bridge import Bridge, BridgeInputs
from follower.can_bridge.gate import StampedCommand
from follower.can_bridge.measurement import BusMeasurement, DriveSetpoint

BOOT = "boot"
HEALTHY = BusMeasurement(
    now_ns=0,
    measured_ns=0,
    wheel_speed_rad_s=(0.0, 0.0),
    wheel_angle_rad=(0.0, 0.0),
    joint_torque_n_m=(0.0,) * 6,
    joint_angle_rad=(0.0,) * 6,
    grip_torque_n_m=(0.0, 0.0),
    grip_angle_rad=(0.0, 0.0),
    lift_m=0.2,
    inputs_fresh=True,
    estop_clear=True,
    protective_clear=True,
    battery_v=25.0,
    states=(DriveState.ENABLED,) * 11,
    wheels_enabled=True,
    arms_enabled=True,
    bus_ok=True,
    faults=(),
    malformed=0,
    unknown=0,
)


class Rig:
    """A bridge, and a mission and measurement that stay fresh while time goes on.

    ``rolling``: speeds of the wheels [rad/s], by which their angles grow.
    """

    def __init__(self, config: Config, mission: Mission) -> None:
        self.bridge = Bridge(config, BOOT)
        self.mission = mission
        self.measured = HEALTHY
        self.rolling = (0.0, 0.0)
        self.now_ns = NS_PER_S
        self.power: list[str | None] = []
        self.commanded = self.arms_lag = False
        self.v_m_s = 0.0
        self.token_ns: int | None = None
        self.setpoint = DriveSetpoint()

    def run(self, cycles: int = 1) -> str:
        for _ in range(cycles):
            self.now_ns += 10 * NS_PER_MS
            header = Header("x", 1, 1, self.now_ns, BOOT)
            arms = ArmSetpoint(self.mission.epoch - self.arms_lag, (0.0,) * 6, (0.0, 0.0), 0.2)
            inputs = BridgeInputs(
                now_ns=self.now_ns,
                command=self._command(),
                mission=Received(self.mission, replace(header, stamp_ns=self.token_ns or self.now_ns), self.now_ns),
                arms=Received(arms, header, self.now_ns),
            )
            self._measure()
            outputs = self.bridge.step(inputs, self.measured)
            self.power.append(outputs.power)
            self.setpoint = outputs.setpoint
        return self.bridge.state

    def roll(self, left_rad_s: float, right_rad_s: float) -> None:
        """From now on the wheels roll at these speeds."""
        self.rolling = (left_rad_s, right_rad_s)
        self.measured = replace(self.measured, wheel_speed_rad_s=self.rolling)

    def _measure(self) -> None:
        left, right = (
            angle + speed / 100 for angle, speed in zip(self.measured.wheel_angle_rad, self.rolling, strict=True)
        )
        self.measured = replace(
            self.measured, now_ns=self.now_ns, measured_ns=self.now_ns, wheel_angle_rad=(left, right)
        )

    def _command(self) -> StampedCommand | None:
        """To go at ``v_m_s``, once it is ``commanded``."""
        if not self.commanded:
            return None
        sequence, until_ns = self.now_ns // (10 * NS_PER_MS), self.now_ns + 100 * NS_PER_MS
        command = Command(self.v_m_s, 0.0, self.mission.epoch, sequence, self.now_ns, until_ns, 1, self.now_ns)
        return StampedCommand(command=seal_command(command), run_id=1, boot_id=BOOT)
