"""Whether the machine that runs the tests keeps time: real-time processes are judged only where it does."""

from __future__ import annotations

import os
import statistics
import threading
import time
from collections.abc import Callable
from types import TracebackType

import pytest

from experiments.stop_times.watch import Canary

# docs/safety.md P01: a trial in which the host stalled for longer says nothing
STALL_MS = 20.0
# both robots, their world and the buses fill most of two cores at half of the usual speed
SLOWNESS = 1.8

_TRIES = 2
_GIVEN_UP = 2  # tests: a host that was in the way of so many stays as it is for a while, others are not repeated
_given_up: list[str] = []
_CALM_S, _PATIENCE_S = 3.0, 60.0
_PACE_ADDITIONS, _PACE_PERIOD_S = 20_000, 0.25
_USUAL_NS = (
    50.0  # of CPU time for an addition in a loop of CPython 3.11, on the cores where docs/safety.md P01 was measured
)


class Pace:
    """How fast the machine computes meanwhile: CPU time of a fixed piece of work, now and then."""

    def __init__(self) -> None:
        self._ns = [_addition_ns()]
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._walk, name="pace", daemon=True)
        self._thread.start()

    def slowness(self) -> float:
        """Median CPU time of the work until now, over the usual one."""
        return statistics.median(self._ns) / _USUAL_NS

    def close(self) -> None:
        """End the thread."""
        self._stop.set()
        self._thread.join()

    def _walk(self) -> None:
        while not self._stop.wait(_PACE_PERIOD_S):
            self._ns.append(_addition_ns())


def _addition_ns() -> float:
    begin_ns, count = time.thread_time_ns(), 0
    for _ in range(_PACE_ADDITIONS):
        count += 1
    return (time.thread_time_ns() - begin_ns) / count


class HostWatch:
    """A canary on each core, above all processes of the robots, and the cores' pace, from its making to its end."""

    def __init__(self) -> None:
        self._canaries = [Canary(cpu) for cpu in sorted(os.sched_getaffinity(0))]
        self._pace = Pace()

    def __enter__(self) -> HostWatch:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._pace.close()
        for canary in self._canaries:
            canary.close()

    def worst_ms(self) -> float:
        """Longest stall of a core until now."""
        return max(canary.worst_ms() for canary in self._canaries)

    def poor(self) -> str:
        """Why no punctuality can be judged, empty if it can."""
        found = []
        if self.worst_ms() > STALL_MS:
            found.append(f"stood still for {self.worst_ms():.0f} ms")
        if self._pace.slowness() > SLOWNESS:
            found.append(f"computed {self._pace.slowness():.1f} times slower than usual")
        return " and ".join(found)


def judged_on_a_calm_host(attempt: Callable[[], None], watch: Callable[[], HostWatch] = HostWatch) -> None:
    """Run ``attempt`` until it passes: a failure is repeated only where the host itself stood still or was slow.

    A stall stops the robots, rightly: it says nothing about what a test asserts. A failure without one stands. Where
    each of the tries fell into one, the test is skipped and says so, with the last failure.
    """
    seen: list[str] = []
    while len(seen) < (_TRIES if len(_given_up) < _GIVEN_UP else 1):
        if seen:
            _until_the_machine_is_calm()
        with watch() as host:
            try:
                attempt()
            except (AssertionError, pytest.fail.Exception) as error:
                if not host.poor() or "pytest-timeout" in str(error):
                    raise
                failure = error
            else:
                return
        seen.append(host.poor())
    _given_up.extend(seen[-1:])
    first_line = str(failure).partition("\n")[0]
    pytest.skip(f"the host {'; then '.join(seen)}: not judged (last failure: {first_line[:200]})")


def _until_the_machine_is_calm() -> None:
    """Wait until nothing has stood still for a while: stalls of the host come in bursts."""
    begin = before = calm_since = time.monotonic()
    while before - calm_since < _CALM_S and before - begin < _PATIENCE_S:
        time.sleep(0.005)
        now = time.monotonic()
        if now - before > STALL_MS / 1e3:
            calm_since = now
        before = now
