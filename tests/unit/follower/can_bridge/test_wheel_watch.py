"""A rim that does not roll: each bound at its edge."""

from __future__ import annotations

import pytest

from follower.can_bridge.wheel_watch import RimWatch

MS = 1_000_000


def stuck_after_ms(told: float, measured: float, limit_ms: int = 1000) -> float:
    """First time at which the watch says so, counted from the first frame; inf for never."""
    watch = RimWatch()
    for n in range(limit_ms + 1):
        if watch.step((7 + n) * MS, told, measured):
            return n
    return float("inf")


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("told", "measured", "after_ms"),
    [
        (0.1, 0.0, 301),
        (0.1, 0.024, 301),
        (0.1, 0.0249, 301),
        (0.1, 0.025, float("inf")),
        (0.1, -0.1, 301),
        (0.02, 0.0, 301),
        (0.0199, 0.0, float("inf")),
        (0.0, 0.3, float("inf")),
        (0.0, -0.3, float("inf")),
        (0.5, 0.13, float("inf")),
    ],
)
def test_less_than_a_quarter_for_longer_than_300_ms(
    sign: float, told: float, measured: float, after_ms: float
) -> None:
    assert stuck_after_ms(sign * told, sign * measured) == after_ms


def test_300_ms_to_the_nanosecond() -> None:
    watch = RimWatch()
    assert not watch.step(0, 0.1, 0.0)
    assert not watch.step(300 * MS, 0.1, 0.0)
    assert watch.step(300 * MS + 1, 0.1, 0.0)


@pytest.mark.parametrize("between", [(0.1, 0.09), (0.0, 0.0), (0.01, 0.0), (-0.1, 0.0)])
def test_rolling_standing_and_turning_back_begin_the_time_anew(between: tuple[float, float]) -> None:
    watch = RimWatch()
    assert not watch.step(0, 0.1, 0.0)
    assert not watch.step(250 * MS, *between)
    assert not watch.step(260 * MS, 0.1, 0.0)
    assert not watch.step(560 * MS, 0.1, 0.0)
    assert watch.step(561 * MS, 0.1, 0.0)


def test_each_way_counts_for_itself() -> None:
    watch = RimWatch()
    for n in range(40):
        assert not watch.step(n * 20 * MS, 0.1 if n % 20 < 10 else -0.1, 0.0)
