"""A wheel's angle against its speed: what lies is found in time, what is merely imperfect is not taken for it."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from common.timing import NS_PER_MS
from follower.can_bridge.angle_watch import AngleWatch

STEP_MS = 10
Lie = Callable[[float], float]
SLOW = 0.0125  # m/s: a wheel of a robot that turns on the spot at .05 rad/s


def found_after_ms(
    speed_m_s: float, angle: Lie = lambda x: x, speed: Lie = lambda v: v, lasts_ms: int = 5000, warm_ms: int = 2000
) -> int | None:
    """Milliseconds from when angle or speed begin to lie until it is found; None: not in time."""
    watch = AngleWatch()
    for n in range((warm_ms + lasts_ms) // STEP_MS):
        lies = n * STEP_MS >= warm_ms
        driven = speed_m_s * n * STEP_MS / 1000.0
        since = speed_m_s * (n * STEP_MS - warm_ms) / 1000.0
        shown = driven - since + angle(since) if lies else driven
        if watch.step(n * STEP_MS * NS_PER_MS, shown, speed(speed_m_s) if lies else speed_m_s):
            return n * STEP_MS - warm_ms
    return None


@pytest.mark.parametrize("speed_m_s", [SLOW, 0.03, 0.1, 0.3, -0.05, -0.3])
@pytest.mark.parametrize(
    ("angle", "speed"),
    [
        (lambda _: 0.0, lambda v: v),  # the angle stands
        (lambda x: -x, lambda v: v),  # the angle runs backwards
        (lambda x: x, lambda _: 0.0),  # the speed stands
        (lambda x: x, lambda v: -v),  # the speed is turned
    ],
)
def test_an_angle_that_does_not_follow_its_speed_is_found_within_300_ms(
    speed_m_s: float, angle: Lie, speed: Lie
) -> None:
    after_ms = found_after_ms(speed_m_s, angle, speed)
    assert after_ms is not None
    assert 0 < after_ms <= 300


@pytest.mark.parametrize(("speed_m_s", "within_ms"), [(0.03, 300), (0.1, 300), (0.3, 300), (SLOW, 2000)])
def test_half_a_scale_is_found(speed_m_s: float, within_ms: int) -> None:
    after_ms = found_after_ms(speed_m_s, lambda x: 0.5 * x)
    assert after_ms is not None
    assert after_ms <= within_ms


@pytest.mark.parametrize("share", [0.9, 0.95, 1.05, 1.1])
def test_a_wheel_that_is_a_little_worn_is_not(share: float) -> None:
    assert found_after_ms(0.3, lambda x: share * x, lasts_ms=20_000) is None


def test_a_speed_filter_of_the_drive_is_not_found_at_the_hardest_acceleration() -> None:
    watch, filtered, driven, speed = AngleWatch(), 0.0, 0.0, 0.0
    for n in range(1000):
        target = 0.5 if (n // 150) % 2 == 0 else -0.2
        speed += max(-0.005, min(0.005, target - speed))
        driven += speed * 0.01
        filtered += (speed - filtered) * (1.0 - math.exp(-0.01 / 0.04))
        assert not watch.step(n * STEP_MS * NS_PER_MS, driven, filtered), n


def test_a_lost_frame_of_the_angle_is_not_found() -> None:
    watch = AngleWatch()
    for n in range(600):
        shown = n - 1 if n % 40 == 39 else n
        assert not watch.step(n * STEP_MS * NS_PER_MS, 0.5 * shown / 100.0, 0.5)


def test_a_gap_in_the_measurements_restarts_it_and_an_old_one_changes_nothing() -> None:
    watch = AngleWatch()
    for n in range(50):
        assert not watch.step(n * STEP_MS * NS_PER_MS, 0.3 * n / 100.0, 0.3)
    after_ns = 50 * STEP_MS * NS_PER_MS + 500 * NS_PER_MS
    assert not watch.step(after_ns, 7.0, 0.3), "what was driven in the gap is not known"
    assert not watch.step(after_ns, -7.0, 0.3), "not newer"
    assert not watch.step(after_ns + STEP_MS * NS_PER_MS, 7.003, 0.3)
