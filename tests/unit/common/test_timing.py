"""Absolute schedules and stepped time."""

from __future__ import annotations

import pytest

from common.timing import NS_PER_S, HeldFor, Schedule, SteppedClock


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


@pytest.mark.parametrize(("strictly", "on_from_ns"), [(False, 300), (True, 301)])
def test_a_condition_that_has_held_long_enough_to_the_nanosecond(strictly: bool, on_from_ns: int) -> None:
    held = HeldFor(300, strictly=strictly)
    assert not held.step(0, False)
    assert not held.step(7, True)
    assert not held.step(7 + on_from_ns - 1, True)
    assert held.step(7 + on_from_ns, True)
    assert held.on
    assert not held.step(7 + on_from_ns + 1, False)
    assert not held.on


def test_without_a_duration_it_follows_the_condition_unless_strictly() -> None:
    assert HeldFor().step(5, True)
    assert not HeldFor().step(5, False)
    strictly = HeldFor(strictly=True)
    assert not strictly.step(5, True)
    assert strictly.step(6, True)


def test_a_break_restarts_the_time() -> None:
    held = HeldFor(100)
    held.step(0, True)
    assert not held.step(90, False)
    assert not held.step(95, True)
    assert not held.step(194, True)
    assert held.step(195, True)


def test_how_long_it_has_held_in_seconds() -> None:
    held = HeldFor()
    assert (held.holding, held.held_s) == (False, 0.0)
    held.step(NS_PER_S, True)
    assert (held.holding, held.held_s) == (True, 0.0)
    held.step(3 * NS_PER_S, True)
    assert held.held_s == 2.0
    held.step(4 * NS_PER_S, False)
    assert (held.holding, held.held_s) == (False, 0.0)


def test_release_hysteresis_keeps_it_on_but_switches_nothing_on() -> None:
    held = HeldFor(100)
    assert not held.step(0, False, stays=True)
    held.step(10, True, stays=True)
    assert not held.step(100, False, stays=True)
    held.step(200, True, stays=True)
    assert held.step(300, True, stays=True)
    assert held.step(310, False, stays=True)
    assert held.step(320, True, stays=True)  # the time restarts, it is on all the same
    assert held.held_s == 0.0
    assert not held.step(330, False)
    assert not held.step(340, False, stays=True)


def test_reset_switches_off_and_counts_again() -> None:
    held = HeldFor(100)
    held.step(0, True)
    assert held.step(100, True)
    held.reset()
    assert (held.on, held.holding, held.held_s) == (False, False, 0.0)
    assert not held.step(150, True)
    assert not held.step(249, True)
    assert held.step(250, True)
