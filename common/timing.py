"""Clocks and schedules. Algorithms never read a clock: executors do, and hand the time on as an argument."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Protocol

NS_PER_S = 1_000_000_000
NS_PER_MS = 1_000_000


class Clock(Protocol):
    """Monotonic nanoseconds and the boot they count from; stamps of two boots are never compared."""

    @property
    def boot_id(self) -> str:
        """Identifies the machine's boot, so that a stamp of an earlier boot is recognised."""

    def now_ns(self) -> int:
        """CLOCK_MONOTONIC, or the time of a simulation."""


class MonotonicClock:
    """CLOCK_MONOTONIC of this machine."""

    def __init__(self) -> None:
        self.boot_id = Path("/proc/sys/kernel/random/boot_id").read_text().strip()

    def now_ns(self) -> int:
        """Nanoseconds since an arbitrary point before this boot's first reading."""
        return time.monotonic_ns()

    def sleep_until(self, deadline_ns: int) -> None:
        """Return at or after the deadline."""
        remaining_ns = deadline_ns - time.monotonic_ns()
        if remaining_ns > 0:
            time.sleep(remaining_ns / NS_PER_S)


class SteppedClock:
    """Time that moves only when told to."""

    boot_id = "stepped"

    def __init__(self, start_ns: int = NS_PER_S) -> None:
        self._now_ns = start_ns

    def now_ns(self) -> int:
        """The simulation's time."""
        return self._now_ns

    def advance_to(self, time_ns: int) -> None:
        """Move on to ``time_ns``.

        Raises:
            ValueError: the time lies in the past.
        """
        if time_ns < self._now_ns:
            raise ValueError(f"time cannot go back from {self._now_ns} to {time_ns} ns")
        self._now_ns = time_ns


class Schedule:
    """Deadlines on an absolute grid; a period that was overslept is skipped and counted, never made up for."""

    def __init__(self, period_ns: int, start_ns: int) -> None:
        self.period_ns = period_ns
        self.deadline_ns = start_ns
        self.missed = 0

    def advance(self, now_ns: int) -> None:
        """Set the next deadline after the one that has just been served at ``now_ns``."""
        self.deadline_ns += self.period_ns
        if now_ns >= self.deadline_ns:
            late = (now_ns - self.deadline_ns) // self.period_ns + 1
            self.missed += late
            self.deadline_ns += late * self.period_ns
