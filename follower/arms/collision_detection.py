"""Collision by joint torque."""

from __future__ import annotations

from collections import deque

from common.config import ArmsConfig
from common.timing import NS_PER_MS, NS_PER_S, HeldFor

# a little less than one, or three, periods of 10 ms: samples do not come to the nanosecond
_SPIKE_NS = 9 * NS_PER_MS
_RATE_WINDOW_NS = 29 * NS_PER_MS


class CollisionDetector:
    """A joint torque over its limit, or one that grows too fast, for 2 samples 10 ms apart: ``docs/safety.md`` S39.

    One sample alone may grow too fast where a command of the base turns casters that swing round under a load.
    """

    def __init__(self, config: ArmsConfig) -> None:
        self._config = config
        self._over, self._fast = HeldFor(_SPIKE_NS), HeldFor(_SPIKE_NS)
        self._recent: deque[tuple[int, tuple[float, ...]]] = deque()

    def step(self, torques_n_m: tuple[float, ...], now_ns: int) -> bool:
        """Take one sample of the six joint torques; whether they tell of a collision."""
        config = self._config
        over = max(map(abs, torques_n_m)) > config.collision_torque_n_m
        fast = self._rate_n_m_s(torques_n_m, now_ns) > config.collision_rate_n_m_s
        over_lasts, fast_lasts = self._over.step(now_ns, over), self._fast.step(now_ns, fast)
        return over_lasts or fast_lasts

    def forget(self) -> None:
        """Samples before this do not count."""
        self._over.reset()
        self._fast.reset()
        self._recent.clear()

    def _rate_n_m_s(self, torques_n_m: tuple[float, ...], now_ns: int) -> float:
        """Fastest growth of a joint's torque over the last 30 ms; samples need not come evenly."""
        recent = self._recent
        recent.append((now_ns, torques_n_m))
        while len(recent) > 1 and now_ns - recent[1][0] >= _RATE_WINDOW_NS:
            recent.popleft()
        oldest_ns, oldest = recent[0]
        age_ns = now_ns - oldest_ns
        if age_ns < _RATE_WINDOW_NS:
            return 0.0
        return max(abs(b) - abs(a) for a, b in zip(oldest, torques_n_m, strict=True)) / (age_ns / NS_PER_S)
