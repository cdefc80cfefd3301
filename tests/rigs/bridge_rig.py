"""A bridge without a bus: its mission and measurement stay fresh while time goes on."""

from __future__ import annotations

from dataclasses import replace

from common.canopen.cia402 import DriveState
from common.config import Config
from common.messages import ArmSetpoint, Command, Header, Mission, seal_command
from common.node import Received
from common.timing import NS_PER_MS, NS_PER_S
from follower.can_bridge.bridge import Bridge, Heard
from follower.can_bridge.gate import StampedCommand
from follower.can_bridge.measurement import DriveSetpoint, Measurement

BOOT = "boot"
HEALTHY = Measurement(
    0, 0, (0.0, 0.0), (0.0, 0.0), (0.0,) * 6, (0.0,) * 6, (0.0, 0.0), (0.0, 0.0), 0.2, True, True, True, 25.0,
    (DriveState.ENABLED,) * 11, True, True, True, (), 0, 0,
)  # fmt: skip


class Rig:
    """A bridge, and a mission and measurement that stay fresh while time goes on."""

    def __init__(self, config: Config, mission: Mission) -> None:
        self.bridge = Bridge(config, BOOT)
        self.mission = mission
        self.measured = HEALTHY
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
            heard = Heard(
                self.now_ns,
                self._command(),
                Received(self.mission, replace(header, stamp_ns=self.token_ns or self.now_ns), self.now_ns),
                Received(arms, header, self.now_ns),
            )
            self.measured = replace(self.measured, now_ns=self.now_ns, measured_ns=self.now_ns)
            orders = self.bridge.step(heard, self.measured)
            self.power.append(orders.power)
            self.setpoint = orders.setpoint
        return self.bridge.state

    def _command(self) -> StampedCommand | None:
        """To go at ``v_m_s``, once it is ``commanded``."""
        if not self.commanded:
            return None
        sequence, until_ns = self.now_ns // (10 * NS_PER_MS), self.now_ns + 100 * NS_PER_MS
        told = Command(self.v_m_s, 0.0, self.mission.epoch, sequence, self.now_ns, until_ns, 1, self.now_ns)
        return StampedCommand(seal_command(told), 1, BOOT)
