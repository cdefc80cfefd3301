"""Whether the robot stands: one judgement for bridge and supervisor."""

from __future__ import annotations

from collections import deque
from typing import Final, Protocol

from common.config import BaseConfig
from common.kinematics import path_from_wheels
from common.timing import NS_PER_S

STANDSTILL_M_S: Final = 0.005
STANDSTILL_RAD_S: Final = 0.02
WINDOW_NS: Final = NS_PER_S // 5
MAX_AGE_NS: Final = NS_PER_S // 10
BRAKING_NS: Final = 2 * NS_PER_S
"""Longest time from a stop to standstill for which the arms are led on: from 0.6 m/s at 0.5 m/s² it takes 1.2 s."""


class WheelAngles(Protocol):
    """A measurement of both wheels: angles [rad], left and right, at ``measured_ns``, negative for never."""

    @property
    def measured_ns(self) -> int:
        """CLOCK_MONOTONIC."""

    @property
    def wheel_angle_rad(self) -> tuple[float, float]:
        """Left, right."""


class Standstill:
    """By the wheels' angles over the last 0.2 s: the speed that a drive measures at rest may be mere noise.

    It neither drives nor turns faster than the limits on average over that time. Wheels that were not measured for
    0.1 s count as turning. Pure: time is an argument.
    """

    def __init__(self, base: BaseConfig) -> None:
        self._base = base
        self._measured: deque[tuple[int, tuple[float, float]]] = deque()
        self._now_ns = 0

    def step(self, now_ns: int, wheels: WheelAngles | None) -> None:
        """Take the newest measurement.

        Args:
            now_ns: CLOCK_MONOTONIC.
            wheels: the newest measurement, new or already seen; None: there is none now.
        """
        measured, self._now_ns = self._measured, now_ns
        newest_ns = measured[-1][0] if measured else -1
        if wheels is not None and wheels.measured_ns > newest_ns:
            measured.append((wheels.measured_ns, wheels.wheel_angle_rad))
            while measured[-1][0] - measured[0][0] > WINDOW_NS and measured[-1][0] - measured[1][0] >= WINDOW_NS:
                measured.popleft()

    @property
    def holds(self) -> bool:
        """Whether it has stood for the whole window."""
        measured = self._measured
        if not measured or self._now_ns - measured[-1][0] > MAX_AGE_NS:
            return False
        if measured[-1][0] - measured[0][0] < WINDOW_NS:
            return False
        newest, window_s = measured[-1][1], WINDOW_NS / NS_PER_S
        for _, angles in measured:
            distance_m, turn_rad = path_from_wheels(self._base, (newest[0] - angles[0], newest[1] - angles[1]))
            if abs(distance_m) > STANDSTILL_M_S * window_s or abs(turn_rad) > STANDSTILL_RAD_S * window_s:
                return False
        return True
