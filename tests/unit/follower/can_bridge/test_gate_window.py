"""The gate's window: no acceleration is earned by time that passed or went wrong."""

from __future__ import annotations

import pytest

from follower.can_bridge.gate import (
    Gate,
)
from tests.rigs.gate_rig import (
    BASE,
    BOOT,
    CLEAR,
    LIMITS,
    MS,
    T0,
    Bench,
    command,
    replace_limits,
    stamped,
    token,
    wheels,
)


def test_a_stall_allows_no_larger_step() -> None:
    bench = Bench()
    bench.order(0.3)
    bench.order(0.3, period_ms=15.0)
    assert bench.order(0.3, period_ms=3000.0).v_m_s == pytest.approx(0.005 + 0.0075)
    assert bench.order(0.3).v_m_s == pytest.approx(0.0125 + 0.01)


def test_a_clock_that_goes_back_allows_no_step() -> None:
    bench = Bench()
    bench.order(0.3)
    before = bench.order(0.3, period_ms=-1.0)
    assert bench.order(0.3, status=wheels(0.0, bench.now_ns)).v_m_s == before.v_m_s


@pytest.mark.parametrize(
    ("v", "w", "reach"), [(0.5, 0.0, 0.125), (-0.1, 0.0, 0.06), (0.0, 0.6, 0.5), (0.0, -0.6, 0.5)]
)
def test_the_window_holds_when_time_itself_is_wrong(v: float, w: float, reach: float) -> None:
    """A clock that swings to and fro gains rate for nothing; 250 real ms allow no more than they should."""
    limits = replace_limits(gate_acceleration_m_s2=0.24) if v < 0 else LIMITS
    bench = Bench(limits)
    clipped: set[str] = set()
    for n in range(100):
        decision = bench.order(v, w, period_ms=10.0 if n % 2 else -10.0)
        clipped.update(decision.clipped)
    assert abs(decision.v_m_s) + abs(decision.w_rad_s) == pytest.approx(reach)
    assert "window" in clipped


def test_the_window_slides_and_forgets() -> None:
    bench = Bench()
    for n in range(100):
        bench.order(0.5, period_ms=10.0 if n % 2 else -10.0)
    assert bench.v == pytest.approx(0.125)
    swung_ns = bench.now_ns
    bench.now_ns = swung_ns + 250 * MS
    assert bench.order(0.5).clipped == ("rate", "window")
    bench.now_ns = swung_ns + 250 * MS + 20 * MS
    assert "window" not in bench.order(0.5).clipped


def test_slowing_down_is_free_in_the_window_and_reversing_is_not() -> None:
    bench = Bench()
    bench.drive(0.5)
    bench.step(token=None, status=wheels(0.5, bench.now_ns))
    ramped = [bench.order(0.5, status=wheels(0.5 - 0.005 * n, bench.now_ns)).v_m_s for n in range(10)]
    assert ramped[-1] == pytest.approx(0.05)
    bench = Bench()
    bench.drive(0.3)
    assert bench.drive(0.0, steps=70).v_m_s == 0.0
    assert bench.drive(-0.1, steps=30).v_m_s == pytest.approx(-0.1)


def test_decision_keeps_no_memory_of_old_windows() -> None:
    gate = Gate(LIMITS, BASE, BOOT)
    for n in range(400):
        gate.step(T0, stamped(command(0.3, sequence=n)), token(), wheels(0.0, T0), CLEAR)
    assert len(gate._window) <= 128
