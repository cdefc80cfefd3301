"""The Leader in the simulated world: LED currents, the bolt behind the guide, switches, and their faults."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

from sim.can.nodes import LeaderBus
from sim.physics.queue import Guide
from sim.world_config import WorldConfig

Switch = Literal["guide_lifted", "beam_seated", "lock_extended", "lock_retracted"]
_LED_TIME_CONSTANT_S = 0.01
_BLOCKED_TRAVEL = 0.5
_TRAVEL_CURRENT_A, _JAM_CURRENT_A = 1.2, 6.0


@dataclass
class LeaderFaults:
    """What is wrong with the Leader; the default is nothing.

    ``dead_leds`` draw no current. ``stuck`` switches always show one value. ``bolt_blocked``: an obstacle stops the
    bolt. Not ``powered``: LEDs dark; the caller silences the module on its bus.
    """

    dead_leds: set[int] = field(default_factory=set)
    stuck: dict[Switch, bool] = field(default_factory=dict)
    bolt_blocked: bool = False
    powered: bool = True


class LeaderPlant:
    """Follows the I/O module's outputs and writes its inputs."""

    def __init__(self, world: WorldConfig, leader: LeaderBus, leds: int, guide: Guide, dt_s: float) -> None:
        self._world, self._leader, self._guide = world, leader, guide
        self.faults = LeaderFaults()
        self.led_current_a = [0.0] * leds
        self.travel = 1.0 if guide.seated else 0.0
        self._led_target = [0.0] * leds
        self._led_share = 1.0 - math.exp(-dt_s / _LED_TIME_CONSTANT_S)
        self._actuator = 0
        self._jammed = False
        self.report()

    @property
    def locked(self) -> bool:
        """The bolt is extended behind a seated beam."""
        return self.travel >= 1.0 and self._guide.seated

    def listen(self) -> None:
        """Read the module's outputs."""
        faults = self.faults
        for i in range(len(self._led_target)):
            lit = faults.powered and i not in faults.dead_leds
            self._led_target[i] = self._leader.led_setpoint_a(i) if lit else 0.0
        self._actuator = self._leader.actuator if faults.powered else 0

    def step(self, dt_s: float) -> None:
        """One step under the outputs read last."""
        for i, target in enumerate(self._led_target):
            self.led_current_a[i] += self._led_share * (target - self.led_current_a[i])
        travel = self.travel + self._actuator * dt_s / self._world.lock_travel_s
        # without a seated beam the guide blocks the bolt
        limit = 1.0 if self._guide.seated and not self.faults.bolt_blocked else max(_BLOCKED_TRAVEL, self.travel)
        self.travel = min(limit, 1.0, max(0.0, travel))
        self._jammed = travel > limit and limit < 1.0

    def report(self) -> None:
        """Write the readings of current sensors and switches to the module's inputs."""
        leader = self._leader
        for i, current in enumerate(self.led_current_a):
            leader.set_led_current(i, current)
        current_a = _JAM_CURRENT_A if self._jammed else _TRAVEL_CURRENT_A
        leader.set_actuator_current(current_a if self._actuator else 0.0)
        switches: dict[Switch, bool] = {
            "guide_lifted": self._guide.lifted,
            "beam_seated": self._guide.seated,
            "lock_extended": self.travel >= 1.0,
            "lock_retracted": self.travel <= 0.0,
        }
        leader.set_switches(**{**switches, **self.faults.stuck})
