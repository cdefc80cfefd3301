"""Whether the machine that runs the tests stood still: real-time processes are judged only where it did not."""

from __future__ import annotations

import os
from types import TracebackType

import pytest

from experiments.stop_watch import Canary

# SAFETY's figures: a trial in which the host stood still for longer says nothing
STALL_MS = 20.0


class HostWatch:
    """A canary on each core, above all processes of the robots, from its making to :meth:`close`."""

    def __init__(self) -> None:
        self._canaries = [Canary(cpu) for cpu in sorted(os.sched_getaffinity(0))]

    def __enter__(self) -> HostWatch:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def worst_ms(self) -> float:
        """Longest stall of a core until now."""
        return max(canary.worst_ms() for canary in self._canaries)

    def stood_still(self) -> bool:
        """Whether a core stood still for so long that nobody's punctuality can be judged."""
        return self.worst_ms() > STALL_MS

    def close(self) -> None:
        """End the canaries; what they saw stays."""
        for canary in self._canaries:
            canary.close()


def cannot_judge(tries: list[HostWatch]) -> None:
    """Skip a test whose every try fell into a stall of the host; nothing if one of them did not."""
    if all(watch.stood_still() for watch in tries):
        worst_ms = max(watch.worst_ms() for watch in tries)
        pytest.skip(f"the host stood still in each of {len(tries)} tries, for up to {worst_ms:.0f} ms: not judged")
