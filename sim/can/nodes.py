"""Nodes on the two simulated CAN buses, built from the configuration of the robots."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from common.canopen.node import find_eds
from common.config import BATTERY_V_PER_COUNT, FollowerCanConfig, LeaderCanConfig
from sim.can.bus import SimulatedBus
from sim.can.drive_402 import Drive402
from sim.can.io_401 import IoModule401


@dataclass(frozen=True)
class FollowerBus:
    """The Follower's drives and I/O module. Inputs: bit 0 e-stop clear, bit 1 protective stop clear."""

    left_wheel: Drive402
    right_wheel: Drive402
    joints: tuple[Drive402, ...]
    grippers: tuple[Drive402, ...]
    lift: Drive402
    io: IoModule401

    @classmethod
    def build(cls, config: FollowerCanConfig, config_path: Path) -> FollowerBus:
        """Switched-on nodes, inputs clear, battery full."""
        eds = find_eds(config.drive_eds, config_path)
        io = IoModule401(config.io_node_id, find_eds(config.io_eds, config_path))
        follower = cls(
            Drive402(config.left_wheel, eds),
            Drive402(config.right_wheel, eds),
            tuple(Drive402(joint, eds) for joint in config.joints),
            tuple(Drive402(gripper, eds) for gripper in config.grippers),
            Drive402(config.lift, eds, units_per_turn=config.lift_lead_m),
            io,
        )
        follower.set_stop_inputs(estop_clear=True, protective_clear=True)
        follower.set_battery(26.0)
        return follower

    @cached_property
    def drives(self) -> tuple[Drive402, ...]:
        """All eleven, in the order wheels, joints, grippers, lift."""
        return (self.left_wheel, self.right_wheel, *self.joints, *self.grippers, self.lift)

    @cached_property
    def bus(self) -> SimulatedBus:
        """The bus with these nodes."""
        return SimulatedBus((*self.drives, self.io))

    def set_stop_inputs(self, estop_clear: bool, protective_clear: bool) -> None:
        """Set the inputs of the wired stop circuits."""
        self.io.set_digital_input(0, estop_clear)
        self.io.set_digital_input(1, protective_clear)

    def set_battery(self, volts: float) -> None:
        """Set the battery voltage that the module measures."""
        self.io.set_analogue_input(1, round(volts / BATTERY_V_PER_COUNT))


@dataclass(frozen=True)
class LeaderBus:
    """The Leader's I/O module, in SI units."""

    io: IoModule401

    @classmethod
    def build(cls, config: LeaderCanConfig, config_path: Path) -> LeaderBus:
        """A switched-on module, everything off."""
        return cls(IoModule401(config.io_node_id, find_eds(config.io_eds, config_path)))

    @cached_property
    def bus(self) -> SimulatedBus:
        """The bus with this module."""
        return SimulatedBus((self.io,))

    def led_setpoint_a(self, led: int) -> float:
        """Commanded current of LED ``led`` (from 0) [A]."""
        return self.io.analogue_output(led + 1) / 1000.0

    @property
    def actuator(self) -> int:
        """Command of the actuator: 1 extend, −1 retract, 0 neither or both."""
        return int(self.io.digital_output(0)) - int(self.io.digital_output(1))

    def set_led_current(self, led: int, current_a: float) -> None:
        """Measured current of LED ``led`` (from 0) [A]."""
        self.io.set_analogue_input(led + 1, round(current_a * 1000.0))

    def set_actuator_current(self, current_a: float) -> None:
        """Measured current of the actuator [A]."""
        self.io.set_analogue_input(5, round(current_a * 1000.0))

    def set_switches(self, guide_lifted: bool, beam_seated: bool, lock_extended: bool, lock_retracted: bool) -> None:
        """Set the four limit switches.

        Args:
            guide_lifted, beam_seated, lock_extended, lock_retracted: whether each is closed.
        """
        for bit, on in enumerate((guide_lifted, beam_seated, lock_extended, lock_retracted)):
            self.io.set_digital_input(bit, on)
