"""A rim that is told to roll and does not: stuck encoder, turned sign or blocked wheel at docking speeds.

SAFETY.md row 22. The gate's bound on the gap between told and measured speed leaves room for lag and load, more than
a docking's last metre is driven at; time tells what a single frame cannot.
"""

from __future__ import annotations

from typing import Final

from common.timing import NS_PER_MS

LEAST_RIM_M_S: Final = 0.02
LEAST_SHARE: Final = 0.25
STUCK_MS: Final = 300


class RimWatch:
    """One rim. Pure: time is an argument."""

    def __init__(self) -> None:
        self._since_ns: int | None = None
        self._ahead = True

    def step(self, now_ns: int, told_m_s: float, measured_m_s: float) -> bool:
        """Whether it has rolled at less than a quarter of what it was told, one way, for longer than 300 ms.

        Args:
            now_ns: CLOCK_MONOTONIC.
            told_m_s: set-point of this frame.
            measured_m_s: newest measurement.
        """
        ahead = told_m_s > 0.0
        along = measured_m_s if ahead else -measured_m_s
        follows = abs(told_m_s) < LEAST_RIM_M_S or along >= LEAST_SHARE * abs(told_m_s)
        if follows:
            self._since_ns = None
        elif self._since_ns is None or ahead != self._ahead:
            self._since_ns, self._ahead = now_ns, ahead
        return self._since_ns is not None and now_ns - self._since_ns > STUCK_MS * NS_PER_MS
