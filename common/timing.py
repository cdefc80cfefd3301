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
    """Time that advances only by :meth:`advance_to`."""

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
    """Deadlines on an absolute grid; missed periods are skipped and counted; the loop never catches up."""

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


class HeldFor:
    """Debouncer: switches on once a condition has held for ``duration_ns`` without a break. Time is an argument.

    Args:
        duration_ns: how long the condition has to hold; the time counts from the first step at which it holds.
        strictly: on only after more than ``duration_ns``; otherwise from exactly ``duration_ns`` on.
    """

    def __init__(self, duration_ns: int = 0, *, strictly: bool = False) -> None:
        self._needed_ns = duration_ns + 1 if strictly else duration_ns
        self._since_ns: int | None = None
        self._held_ns = 0
        self.on = False

    @property
    def holding(self) -> bool:
        """Whether the condition held at the last step, for however short a time."""
        return self._since_ns is not None

    @property
    def held_s(self) -> float:
        """For how long it had held at the last step [s]; 0 if it did not."""
        return self._held_ns / NS_PER_S

    def step(self, now_ns: int, holds: bool, *, stays: bool = False) -> bool:
        """Take the condition of this step.

        Args:
            now_ns: time of the step, never before that of the last one.
            holds: whether the condition holds now.
            stays: release hysteresis: once on, it stays on while this is true even if the condition does not hold.

        Returns:
            Whether it is on.
        """
        if not holds:
            self._since_ns = None
        elif self._since_ns is None:
            self._since_ns = now_ns
        self._held_ns = 0 if self._since_ns is None else now_ns - self._since_ns
        long_enough = holds and self._held_ns >= self._needed_ns
        self.on = long_enough or (self.on and (holds or stays))
        return self.on

    def reset(self) -> None:
        """Switch off, and count from the next step at which the condition holds."""
        self._since_ns, self._held_ns, self.on = None, 0, False
