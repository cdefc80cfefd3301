"""Odometry: how far {F} went between two measurements of the wheels.

From angles, not speeds: nothing is lost between two samples, and a late or dropped one only makes the step longer.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from common.config import BaseConfig
from common.kinematics import path_from_wheels
from common.timing import NS_PER_S

Break = Literal["first", "repeated", "jump"]
FASTEST_RAD_S = 15.0  # a wheel that seems faster than this was restarted, or its encoder jumped


@dataclass(frozen=True)
class PoseIncrement:
    """What the robot drove between two measurements.

    Attributes:
        distance_m: along the arc, negative backwards.
        turn_rad: of {F}.
        duration_ns: the time in between.
    """

    distance_m: float
    turn_rad: float
    duration_ns: int

    @property
    def twist(self) -> tuple[float, float]:
        """Mean (v [m/s], ω [rad/s]) of the arc."""
        duration_s = self.duration_ns / NS_PER_S
        return self.distance_m / duration_s, self.turn_rad / duration_s


class WheelOdometry:
    """Takes measured wheel angles as they come."""

    def __init__(self, base: BaseConfig) -> None:
        self._base = base
        self._last: tuple[int, tuple[float, float]] | None = None

    def advance(self, measured_ns: int, wheel_angle_rad: tuple[float, float]) -> PoseIncrement | Break:
        """The increment since the last measurement, or why there is none.

        ``first``: nothing to compare with. ``repeated``: not newer than the last one. ``jump``: an angle that no
        wheel can have turned to, or none at all; counting restarts from the next measurement.
        """
        if not all(map(math.isfinite, wheel_angle_rad)):
            self._last = None
            return "jump"
        if self._last is not None and measured_ns <= self._last[0]:
            return "repeated"
        before, self._last = self._last, (measured_ns, wheel_angle_rad)
        if before is None:
            return "first"
        duration_ns = measured_ns - before[0]
        turned = wheel_angle_rad[0] - before[1][0], wheel_angle_rad[1] - before[1][1]
        if max(map(abs, turned)) > FASTEST_RAD_S * duration_ns / NS_PER_S:
            return "jump"
        return PoseIncrement(*path_from_wheels(self._base, turned), duration_ns)
