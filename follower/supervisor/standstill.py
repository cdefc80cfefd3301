"""Whether the robot stands."""

from __future__ import annotations

from collections import deque

from common.config import BaseConfig
from common.kinematics import path_from_wheels
from common.messages import Drives
from common.timing import NS_PER_S

_STANDSTILL_M_S, _STANDSTILL_RAD_S = 0.005, 0.02
_WINDOW_NS = NS_PER_S // 5
_NEWEST_NS = NS_PER_S // 10


class Standstill:
    """By the wheels' angles over the last 0.2 s: what a drive reads as its speed at rest may be mere noise.

    Wheels that were not measured for 0.1 s count as turning.
    """

    def __init__(self, base: BaseConfig) -> None:
        self._base = base
        self._seen: deque[tuple[int, tuple[float, float]]] = deque()
        self._now_ns = 0

    def step(self, now_ns: int, drives: Drives | None) -> None:
        """Take the newest measurement; None: the drives are not heard now."""
        seen, self._now_ns = self._seen, now_ns
        if drives is not None and (not seen or drives.measured_ns > seen[-1][0]):
            seen.append((drives.measured_ns, drives.wheel_angle_rad))
            while seen[-1][0] - seen[0][0] > _WINDOW_NS and seen[-1][0] - seen[1][0] >= _WINDOW_NS:
                seen.popleft()

    @property
    def holds(self) -> bool:
        """Whether it stood all that time."""
        seen = self._seen
        if not seen or self._now_ns - seen[-1][0] > _NEWEST_NS or seen[-1][0] - seen[0][0] < _WINDOW_NS:
            return False
        newest, window_s = seen[-1][1], _WINDOW_NS / NS_PER_S
        for _, angles in seen:
            way_m, turn_rad = path_from_wheels(self._base, (newest[0] - angles[0], newest[1] - angles[1]))
            if abs(way_m) > _STANDSTILL_M_S * window_s or abs(turn_rad) > _STANDSTILL_RAD_S * window_s:
                return False
        return True
