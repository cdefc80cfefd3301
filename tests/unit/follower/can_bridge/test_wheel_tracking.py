"""A wheel that does not roll: each bound at its edge."""

from __future__ import annotations

import pytest

from follower.can_bridge.wheel_tracking import WheelTrackingMonitor

MS = 1_000_000


def stuck_after_ms(commanded: float, measured: float, limit_ms: int = 1000) -> float:
    """First time at which the monitor reports it, counted from the first frame; inf for never."""
    monitor = WheelTrackingMonitor()
    for n in range(limit_ms + 1):
        if monitor.step((7 + n) * MS, commanded, measured):
            return n
    return float("inf")


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("commanded", "measured", "after_ms"),
    [
        (0.1, 0.0, 301),
        (0.1, 0.024, 301),
        (0.1, 0.0249, 301),
        (0.1, 0.025, float("inf")),
        (0.1, -0.1, 301),
        (0.02, 0.0, 301),
        (0.0199, 0.0, float("inf")),
        (0.0125, -0.0125, 301),
        (0.005, -0.00126, 301),
        (0.005, -0.00125, float("inf")),
        (0.0049, -0.0049, float("inf")),
        (0.0, 0.3, float("inf")),
        (0.0, -0.3, float("inf")),
        (0.5, 0.13, float("inf")),
    ],
)
def test_less_than_a_quarter_for_longer_than_300_ms(
    sign: float, commanded: float, measured: float, after_ms: float
) -> None:
    assert stuck_after_ms(sign * commanded, sign * measured) == after_ms


def test_300_ms_to_the_nanosecond() -> None:
    monitor = WheelTrackingMonitor()
    assert not monitor.step(0, 0.1, 0.0)
    assert not monitor.step(300 * MS, 0.1, 0.0)
    assert monitor.step(300 * MS + 1, 0.1, 0.0)


@pytest.mark.parametrize("between", [(0.1, 0.09), (0.0, 0.0), (0.01, 0.0), (-0.1, 0.0)])
def test_rolling_standing_and_turning_back_restart_the_time(between: tuple[float, float]) -> None:
    monitor = WheelTrackingMonitor()
    assert not monitor.step(0, 0.1, 0.0)
    assert not monitor.step(250 * MS, *between)
    assert not monitor.step(260 * MS, 0.1, 0.0)
    assert not monitor.step(560 * MS, 0.1, 0.0)
    assert monitor.step(561 * MS, 0.1, 0.0)


def test_each_direction_counts_for_itself() -> None:
    monitor = WheelTrackingMonitor()
    for n in range(40):
        assert not monitor.step(n * 20 * MS, 0.1 if n % 20 < 10 else -0.1, 0.0)
