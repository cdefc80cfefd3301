"""Absolute schedules and stepped time."""

from __future__ import annotations

import pytest

from common.timing import Schedule, SteppedClock


def test_deadlines_stay_on_the_grid_however_late_each_was_served() -> None:
    schedule = Schedule(10, start_ns=100)
    schedule.advance(now_ns=104)
    assert schedule.deadline_ns == 110
    schedule.advance(now_ns=119)
    assert (schedule.deadline_ns, schedule.missed) == (120, 0)


def test_overslept_periods_are_skipped_and_counted() -> None:
    schedule = Schedule(10, start_ns=100)
    schedule.advance(now_ns=135)
    assert (schedule.deadline_ns, schedule.missed) == (140, 3)


def test_stepped_time_does_not_go_back() -> None:
    clock = SteppedClock(5)
    clock.advance_to(9)
    assert clock.now_ns() == 9
    with pytest.raises(ValueError, match="cannot go back"):
        clock.advance_to(8)
