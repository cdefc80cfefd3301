"""Loops that come late: a computer that cannot keep up is found before a message is too old to use.

docs/safety.md S29.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Final

from common.timing import NS_PER_S

LATE_LOOPS: Final = 3
WITHIN_S: Final = 1.0


class LateWatch:
    """Counts the late loops of each process over the last second. Pure: time and counts are arguments."""

    def __init__(self) -> None:
        self._counted: deque[tuple[int, dict[str, int]]] = deque()

    def step(self, now_ns: int, late: Mapping[str, int]) -> str:
        """The process with three late loops or more within the last second; empty if there is none.

        Args:
            now_ns: time of this step.
            late: how many loops of each process were late since the start.
        """
        self._counted.append((now_ns, dict(late)))
        while now_ns - self._counted[0][0] > WITHIN_S * NS_PER_S:
            self._counted.popleft()
        before = self._counted[0][1]
        found = [name for name, count in late.items() if count - before.get(name, count) >= LATE_LOOPS]
        return found[0] if found else ""
