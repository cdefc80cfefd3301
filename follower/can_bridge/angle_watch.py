"""A wheel whose angle does not follow its speed: an encoder that stands, runs backwards or at another scale.

docs/safety.md S22. Dead reckoning lives on angles, the gate's other rules on speeds: neither alone shows that the
other lies. A drive measures both on one encoder, so that they agree but for the lag of its speed filter, a small
speed at rest, and a frame that is lost.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from operator import itemgetter
from typing import Final

from common.timing import NS_PER_MS, NS_PER_S

WINDOWS_MS: Final = (280, 2000)
JUDGED_FROM_MS: Final = 100
LAGS_MS: Final = (0, 20, 40, 60)
GAP_M: Final = 0.0007
CREEP_M_S: Final = 0.002
SHARE: Final = 0.20
MAX_STEP_MS: Final = 50

_Sample = tuple[int, float, float, float]  # time, angle, and by the speed: path and distance driven


class AngleWatch:
    """One wheel, as distances at its surface. Pure: time is an argument."""

    def __init__(self) -> None:
        self._samples: deque[_Sample] = deque()
        self._speed_m_s = 0.0

    def step(self, measured_ns: int, angle_m: float, speed_m_s: float) -> bool:
        """Whether angle and speed disagree over the last 280 ms, or over the last 2 s.

        Args:
            measured_ns: when both were measured; a measurement that is not newer changes nothing.
            angle_m: angle of the wheel times its radius.
            speed_m_s: speed of the wheel's surface.
        """
        if self._samples and measured_ns <= self._samples[-1][0]:
            return False
        if self._samples and measured_ns - self._samples[-1][0] > MAX_STEP_MS * NS_PER_MS:
            self._samples.clear()  # no speed says what the wheel did in the gap
        before_ns, _, path_m, driven_m = self._samples[-1] if self._samples else (measured_ns, 0.0, 0.0, 0.0)
        moved_m = (self._speed_m_s + speed_m_s) / 2.0 * (measured_ns - before_ns) / NS_PER_S
        self._speed_m_s = speed_m_s
        self._samples.append((measured_ns, angle_m, path_m + moved_m, driven_m + abs(moved_m)))
        while measured_ns - self._samples[0][0] > (WINDOWS_MS[-1] + LAGS_MS[-1]) * NS_PER_MS:
            self._samples.popleft()
        return any(map(self._disagree, WINDOWS_MS))

    def _disagree(self, window_ms: int) -> bool:
        newest_ns, _, path_m, driven_m = self._samples[-1]
        first_ns, _, first_m, first_driven_m = self._from(newest_ns - window_ms * NS_PER_MS)
        span_ns = newest_ns - first_ns
        if span_ns < JUDGED_FROM_MS * NS_PER_MS:
            return False
        by_angle = [
            self._from(newest_ns - lag_ms * NS_PER_MS)[1] - self._from(first_ns - lag_ms * NS_PER_MS)[1]
            for lag_ms in LAGS_MS
        ]
        gap_m = min(abs(angle_m - (path_m - first_m)) for angle_m in by_angle)
        farther_m = max(driven_m - first_driven_m, min(map(abs, by_angle)))
        return gap_m > GAP_M + CREEP_M_S * span_ns / NS_PER_S + SHARE * farther_m

    def _from(self, since_ns: int) -> _Sample:
        """The oldest sample that is not older."""
        return self._samples[bisect_left(self._samples, since_ns, key=itemgetter(0))]
