"""The gate's rules about wheels: encoders that jump, and wheels that do not follow."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

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
    RADIUS,
    T0,
    TRACK,
    Bench,
    command,
    replace_limits,
    stamped,
    surfaces,
    token,
    wheels,
)


@pytest.mark.parametrize("beyond", [-1e-6, 1e-6])
@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_an_encoder_jump_stops_it(beyond: float, side: int, direction: float) -> None:
    bench = Bench()
    bench.drive(0.2)
    speeds = [0.2, 0.2]
    speeds[side] += direction * (0.30 + beyond)
    decision = bench.step(status=surfaces(speeds[0], speeds[1], bench.now_ns))
    assert (decision.rule == "measured_jump") == (beyond > 0)


@pytest.mark.parametrize("beyond", [-1e-6, 1e-6])
@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_an_angle_that_jumps_stops_it_however_steady_the_speed(beyond: float, side: int, direction: float) -> None:
    bench = Bench()
    bench.drive(0.2)
    before = [1.0, -2.0]
    bench.now_ns += 41 * MS  # too long ago for the angles to be compared
    bench.order(0.2, status=replace(wheels(0.2, bench.now_ns), left_rad=before[0], right_rad=before[1]))
    before[side] += direction * (0.05 + beyond) / RADIUS
    decision = bench.order(0.2, status=replace(wheels(0.2, bench.now_ns), left_rad=before[0], right_rad=before[1]))
    assert (decision.rule == "measured_jump") == (beyond > 0)


@pytest.mark.parametrize("beyond", [False, True])
@pytest.mark.parametrize(("field", "bound"), [("left_rad_s", 0.30), ("right_rad", 0.05)])
def test_a_jump_of_exactly_the_bound_is_accepted(field: str, bound: float, beyond: bool) -> None:
    gate = Gate(LIMITS, BASE, BOOT)
    gate.step(T0, None, token(T0), wheels(0.0, T0), CLEAR)
    step = bound / RADIUS
    assert step * RADIUS == bound
    later = T0 + 10 * MS
    changed: dict[str, Any] = {field: step + 1e-12 if beyond else step}
    status = replace(wheels(0.0, later), **changed)
    newest = stamped(command(stamp_ns=later))
    assert gate.step(later, newest, token(later), status, CLEAR).rule == ("measured_jump" if beyond else "")


def test_a_jump_counts_only_between_two_recent_measurements() -> None:
    bench = Bench()
    bench.step(status=wheels(0.0, -1))
    assert bench.order(0.1, status=wheels(0.5, bench.now_ns)).rule == ""
    before_ns = bench.now_ns - 10 * MS
    for gap_ms, rule in ((50, "measured_jump"), (51, "")):
        gate = Gate(LIMITS, BASE, BOOT)
        gate.step(before_ns, None, token(before_ns), wheels(0.0, before_ns), CLEAR)
        now_ns = before_ns + gap_ms * MS
        newest = stamped(command(stamp_ns=now_ns))
        assert gate.step(now_ns, newest, token(now_ns), wheels(0.5, now_ns), CLEAR).rule == rule


@pytest.mark.parametrize("second_ns", [0, 10 * MS])
def test_a_jump_is_seen_from_time_zero_on(second_ns: int) -> None:
    gate = Gate(LIMITS, BASE, BOOT)
    gate.step(0, stamped(command(stamp_ns=0)), token(0), wheels(0.0, 0), CLEAR)
    assert gate.step(second_ns, None, token(0), wheels(0.5, second_ns), CLEAR).rule == "measured_jump"


def test_a_jump_to_never_measured_is_an_old_status() -> None:
    bench = Bench()
    bench.drive(0.2)
    assert bench.step(status=wheels(0.9, -1)).rule == "status_age"
    assert bench.order(0.2).rule == ""


@pytest.mark.parametrize("beyond", [-1e-6, 1e-6])
@pytest.mark.parametrize(("v", "w"), [(0.3, 0.0), (-0.1, 0.0), (0.1, 0.6), (0.1, -0.6)])
@pytest.mark.parametrize("side", [0, 1])
def test_wheels_that_do_not_follow_stop_it(v: float, w: float, side: int, beyond: float) -> None:
    bench = Bench(replace_limits(w_max_rad_s=0.8), w_max_rad_s=0.8)
    bench.drive(v, w)
    turn = w * TRACK / 2
    speeds = [v - turn, v + turn]
    set_m_s = speeds[side]
    speeds[side] -= math.copysign(0.15 + 0.2 * abs(set_m_s) + beyond, set_m_s)
    decision = bench.order(
        v,
        w,
        status=surfaces(speeds[0], speeds[1], bench.now_ns),
    )
    assert (decision.rule == "measured_gap") == (beyond > 0)


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("v", [0.05, -0.05])
@pytest.mark.parametrize("share", [0.24, 0.26, -1.0])
def test_a_wheel_that_hardly_rolls_at_docking_speed_stops_it_after_300_ms(side: int, v: float, share: float) -> None:
    bench = Bench()
    bench.drive(v)
    speeds = [v, v]
    speeds[side] = share * v
    found, began_ns = [], bench.now_ns
    for _ in range(40):
        status = surfaces(speeds[0], speeds[1], bench.now_ns)
        found.append((bench.now_ns - began_ns, bench.order(v, status=status).rule))
    stopped = [after_ns for after_ns, rule in found if rule]
    assert stopped[:1] == ([] if share > 0.25 else [310 * MS])


def test_time_without_a_setpoint_for_a_wheel_does_not_count() -> None:
    bench = Bench()
    for v in (0.1, 0.0, -0.1, 0.0) * 4:
        for _ in range(28):
            assert bench.order(v, status=wheels(0.0, bench.now_ns)).rule == ""


def test_wheels_that_run_ahead_of_a_slower_setpoint_do_not_stop_it() -> None:
    bench = Bench()
    bench.drive(0.2)
    for ahead in (0.4, -0.4 + 0.6):
        assert bench.order(0.2, status=wheels(ahead, bench.now_ns)).rule == ""
    bench = Bench()
    assert bench.order(0.0, status=wheels(0.5, bench.now_ns)).rule == ""
    assert bench.order(0.0, status=wheels(0.5, bench.now_ns)).rule == ""
    assert bench.order(-0.0, status=wheels(0.3, bench.now_ns)).rule == ""
