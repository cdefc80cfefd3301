"""Where exactly the watch of a wheel's angle begins to disagree, in steps of 1 ms."""

from __future__ import annotations

import pytest

from common.timing import NS_PER_MS
from follower.can_bridge.angle_watch import (
    CREEP_M_S,
    GAP_M,
    JUDGED_FROM_MS,
    LAGS_MS,
    MAX_STEP_MS,
    SHARE,
    WINDOWS_MS,
    AngleWatch,
)

QUIET_MS = 3000


def found_after_ms(creep_m_s: float, speed_m_s: float = 0.0, lasts_ms: int = 3000) -> int | None:
    """Milliseconds until an angle that creeps beside its speed is found, after a quiet time."""
    watch = AngleWatch()
    for ms in range(QUIET_MS + lasts_ms):
        crept_m = creep_m_s * max(0, ms - QUIET_MS) / 1000.0
        if watch.step(ms * NS_PER_MS, speed_m_s * ms / 1000.0 + crept_m, speed_m_s):
            return ms - QUIET_MS
    return None


def test_the_numbers_of_the_concept() -> None:
    assert (GAP_M, CREEP_M_S, SHARE) == (0.0007, 0.002, 0.20)
    assert (WINDOWS_MS, LAGS_MS) == ((280, 2000), (0, 20, 40, 60))
    assert (JUDGED_FROM_MS, MAX_STEP_MS) == (100, 50)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_creep_is_found_from_where_it_exceeds_the_allowance_of_the_short_window(direction: float) -> None:
    # in 0.28 s: 0.7 mm + 2 mm/s · 0.28 s + a fifth of the path
    least_m_s = (0.0007 / 0.28 + 0.002) / 0.8
    assert found_after_ms(1.0005 * direction * least_m_s) == 280 + 60
    later = found_after_ms(0.9995 * direction * least_m_s)
    assert later is not None
    assert later > 280 + 60


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_slower_creep_is_found_by_the_long_window_or_allowed(direction: float) -> None:
    least_m_s = (0.0007 / 2.0 + 0.002) / 0.8
    assert found_after_ms(1.0002 * direction * least_m_s, lasts_ms=4000) == 2000 + 60
    assert found_after_ms(0.9999 * direction * least_m_s, lasts_ms=6000) is None


def test_of_a_wheel_that_rolls_a_fifth_of_the_path_is_allowed_too() -> None:
    least_m_s = (0.0007 / 0.28 + 0.002 + 0.2 * 0.1) / 0.8
    assert found_after_ms(1.0005 * least_m_s, 0.1) == 280 + 60
    later = found_after_ms(0.9995 * least_m_s, 0.1)
    assert later is not None
    assert later > 280 + 60


def test_of_several_lags_the_one_that_agrees_best_counts() -> None:
    """Two steps within the longest lag: the first alone is judged until the second has passed it too."""
    watch, found = AngleWatch(), []
    for ms in range(600):
        angle_m = 0.0017 * (ms >= 400) + 0.01 * (ms >= 450)
        if watch.step(ms * NS_PER_MS, angle_m, 0.0):
            found.append(ms)
    assert found[0] == 400 + 60


def test_the_share_counts_the_path_driven_also_to_and_fro() -> None:
    watch, angle_m = AngleWatch(), 0.0
    for ms in range(3000):
        speed_m_s = 0.2 if (ms // 50) % 2 else -0.2
        angle_m += speed_m_s / 1000.0
        assert not watch.step(ms * NS_PER_MS, angle_m + 0.01 * (ms > 2500), speed_m_s), ms


@pytest.mark.parametrize("starts_at_m", [0.0, 7.0])
def test_it_judges_from_the_hundredth_millisecond_on(starts_at_m: float) -> None:
    watch = AngleWatch()
    found = [watch.step(ms * NS_PER_MS, starts_at_m + 2.0 * ms / 1000.0, 0.3) for ms in range(101)]
    assert found == [False] * 100 + [True]


@pytest.mark.parametrize(("gap_ms", "found"), [(50, True), (51, False)])
def test_a_step_of_more_than_50_ms_is_a_gap(gap_ms: int, found: bool) -> None:
    watch = AngleWatch()
    for ms in range(300):
        assert not watch.step(ms * NS_PER_MS, 0.0, 0.0)
    seen = [watch.step((299 + gap_ms + ms) * NS_PER_MS, 0.05, 0.0) for ms in range(99)]
    assert any(seen) == found


@pytest.mark.parametrize("back_ms", [0, 1, 200])
def test_an_old_measurement_changes_nothing(back_ms: int) -> None:
    watch = AngleWatch()
    for ms in range(600):
        assert not watch.step(ms * NS_PER_MS, 0.3 * ms / 1000.0, 0.3), ms
        assert not watch.step((ms - back_ms) * NS_PER_MS, -7.0, 5.0), ms


def test_the_first_measurement_is_not_measured_against_zero() -> None:
    watch = AngleWatch()
    assert not watch.step(0, 9.0, 5.0)
    for ms in range(1, 300):
        assert not watch.step(ms * NS_PER_MS, 9.0 + 5.0 * ms / 1000.0, 5.0)


def test_it_keeps_no_more_than_the_windows_need() -> None:
    watch = AngleWatch()
    for ms in range(5000):
        watch.step(ms * NS_PER_MS, 0.0, 0.0)
    assert len(watch._samples) == 2000 + 60 + 1
