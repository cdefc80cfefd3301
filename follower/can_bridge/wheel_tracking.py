"""A wheel that is commanded to roll and does not: stuck encoder, inverted sign or blocked wheel at docking speeds.

docs/safety.md S22. The gate's bound on the gap between commanded and measured speed leaves room for lag and load, and
that is more than the speed of a docking's last metre; time shows what a single frame cannot.
"""

from __future__ import annotations

import math
from typing import Final

from common.timing import NS_PER_MS, HeldFor

LEAST_SURFACE_M_S: Final = 0.02
LEAST_BACKWARD_M_S: Final = 0.005
LEAST_SHARE: Final = 0.25
STUCK_MS: Final = 300


class WheelTrackingMonitor:
    """Follows one wheel. Pure: time is an argument."""

    def __init__(self) -> None:
        self._lagging = HeldFor(STUCK_MS * NS_PER_MS, strictly=True)
        self._direction: float | None = None

    def step(self, now_ns: int, commanded_m_s: float, measured_m_s: float) -> bool:
        """Whether it has rolled at less than a quarter of its set-point, or backward, for longer than 300 ms.

        Args:
            now_ns: CLOCK_MONOTONIC.
            commanded_m_s: set-point of the wheel's surface speed in this frame.
            measured_m_s: newest measurement of it.
        """
        direction = math.copysign(1.0, commanded_m_s)
        if direction != self._direction:
            self._direction = direction
            self._lagging.reset()
        commanded, measured = abs(commanded_m_s), direction * measured_m_s
        lags = commanded >= LEAST_SURFACE_M_S and measured < LEAST_SHARE * commanded
        # slower, a motor's dead zone may hold the wheel; nothing turns it the other way
        backward = commanded >= LEAST_BACKWARD_M_S and measured < -LEAST_SHARE * commanded
        return self._lagging.step(now_ns, lags or backward)
