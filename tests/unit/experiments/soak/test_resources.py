"""What a process holds, and how fast it grows."""

from __future__ import annotations

import os
import threading

import pytest

from experiments.soak.resources import held, slope_per_h


def test_descriptors_and_threads_are_seen_as_they_come() -> None:
    before = held(os.getpid(), 1.0)
    assert before.resident_mb > 1.0
    release = threading.Event()
    thread = threading.Thread(target=release.wait)
    thread.start()
    reading, writing = os.pipe()
    during = held(os.getpid(), 2.0)
    release.set()
    thread.join()
    os.close(reading)
    os.close(writing)
    assert (during.descriptors - before.descriptors, during.threads - before.threads) == (2, 1)
    with pytest.raises(OSError, match="No such file"):
        held(2**30, 0.0)


def test_a_slope_is_that_of_the_line_and_needs_three_points() -> None:
    assert slope_per_h([0.0, 1800.0, 3600.0], [10.0, 11.0, 12.0]) == pytest.approx(2.0)
    assert slope_per_h([0.0, 1.0], [1.0, 2.0]) is None
    assert slope_per_h([5.0, 5.0, 5.0], [1.0, 2.0, 3.0]) is None
