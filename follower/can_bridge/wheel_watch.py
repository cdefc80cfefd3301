"""A rim that is told to roll and does not: stuck encoder, turned sign or blocked wheel at docking speeds.

SAFETY.md row 22. The gate's bound on the gap between told and measured speed leaves room for lag and load, more than
a docking's last metre is driven at; time tells what a single frame cannot.
"""

from __future__ import annotations

import math
from typing import Final

from common.timing import NS_PER_MS

LEAST_RIM_M_S: Final = 0.02
LEAST_SHARE: Final = 0.25
STUCK_MS: Final = 300


class RimWatch:
    """One rim. Pure: time is an argument."""

    def __init__(self) -> None:
        self._began: tuple[int, float] | None = None

    def step(self, now_ns: int, told_m_s: float, measured_m_s: float) -> bool:
        """Whether it has rolled at less than a quarter of what it was told, one way, for longer than 300 ms.

        Args:
            now_ns: CLOCK_MONOTONIC.
            told_m_s: set-point of this frame.
            measured_m_s: newest measurement.
        """
        way = math.copysign(1.0, told_m_s)
        if abs(told_m_s) < LEAST_RIM_M_S or way * measured_m_s >= LEAST_SHARE * abs(told_m_s):
            self._began = None
        elif self._began is None or self._began[1] != way:
            self._began = now_ns, way
        return self._began is not None and now_ns - self._began[0] > STUCK_MS * NS_PER_MS
