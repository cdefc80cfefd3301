"""Three late loops within a second name their process."""

from __future__ import annotations

import pytest

from common.timing import NS_PER_MS
from follower.supervisor.late_watch import LateWatch


def named(late_at_ms: list[int], until_ms: int = 3000) -> list[int]:
    """When [ms] the bridge is named, if its loops are late at these times; the supervisor looks every 50 ms."""
    watch, found = LateWatch(), []
    for now_ms in range(0, until_ms, 50):
        count = sum(at_ms <= now_ms for at_ms in late_at_ms)
        if watch.step(now_ms * NS_PER_MS, {"arms": 0, "bridge": count}) == "bridge":
            found.append(now_ms)
    return found


@pytest.mark.parametrize("late_at_ms", [[], [500], [500, 600], [500, 1001, 1600], [100, 700, 1300, 1900, 2500]])
def test_fewer_than_three_in_a_second_are_not_named(late_at_ms: list[int]) -> None:
    assert named(late_at_ms) == []


def test_three_are_named_at_once_and_for_a_second() -> None:
    found = named([1000, 1060, 1120])
    assert found[0] == 1150
    assert found[-1] == 1950


def test_the_first_look_knows_no_earlier_loops() -> None:
    watch = LateWatch()
    assert watch.step(0, {"bridge": 100}) == ""
    assert watch.step(50 * NS_PER_MS, {"bridge": 102}) == ""
    assert watch.step(100 * NS_PER_MS, {"bridge": 103}) == "bridge"


def test_a_process_that_appears_later_begins_from_nothing() -> None:
    watch = LateWatch()
    assert watch.step(0, {}) == ""
    assert watch.step(50 * NS_PER_MS, {"bridge": 7}) == ""


@pytest.mark.parametrize(("after_ms", "found"), [(1000, "bridge"), (1010, "")])
def test_what_is_older_than_a_second_no_longer_counts(after_ms: int, found: str) -> None:
    watch = LateWatch()
    assert watch.step(0, {"bridge": 0}) == ""
    assert watch.step(5 * NS_PER_MS, {"bridge": 2}) == ""
    assert watch.step(after_ms * NS_PER_MS, {"bridge": 3}) == found
