"""The gate's caps: of code, configuration, mission, wheel and phase."""

from __future__ import annotations

from typing import Any

import pytest

from common.ceilings import PHASE_CAPS
from common.messages import PHASES, Phase
from follower.can_bridge.gate import (
    _beyond,
)
from tests.rigs.gate_rig import (
    LIMITS,
    TRACK,
    Bench,
    replace_limits,
)


def test_a_cap_scales_both_and_keeps_the_curvature() -> None:
    bench = Bench(v_max_m_s=0.1)
    decision = bench.drive(0.4, 0.2)
    assert decision.v_m_s == pytest.approx(0.1)
    assert decision.w_rad_s == pytest.approx(0.05)
    assert decision.clipped == ("cap",)


def test_a_lowered_cap_holds_at_once() -> None:
    bench = Bench()
    bench.drive(0.4, 0.2)
    bench.standing = {"v_max_m_s": 0.1}
    decision = bench.order(0.4, 0.2)
    assert decision.v_m_s == pytest.approx(0.1)
    assert decision.w_rad_s == pytest.approx(0.05)
    assert decision.clipped == ("cap", "rate")


@pytest.mark.parametrize(
    ("v", "w", "cap", "expected"),
    [
        (9.0, 0.0, {}, (0.5, 0.0)),
        (-9.0, 0.0, {}, (-0.1, 0.0)),
        (0.0, 9.0, {}, (0.0, 0.6)),
        (0.0, -9.0, {}, (0.0, -0.6)),
        (0.0, 9.0, {"w_max_rad_s": 0.2}, (0.0, 0.2)),
        (-9.0, 0.0, {"v_max_m_s": 0.05}, (-0.05, 0.0)),
        (0.5, 0.6, {}, (0.5 * 0.6 / 0.65, 0.6 * 0.6 / 0.65)),
        (0.5, -0.6, {}, (0.5 * 0.6 / 0.65, -0.6 * 0.6 / 0.65)),
    ],
)
def test_caps_of_configuration_mission_and_wheels(
    v: float, w: float, cap: dict[str, Any], expected: tuple[float, float]
) -> None:
    decision = Bench(**cap).drive(v, w, steps=300)
    assert (decision.v_m_s, decision.w_rad_s) == pytest.approx(expected)


def test_constants_in_code_stand_above_the_configuration() -> None:
    loose = LIMITS.model_copy(
        update={
            "v_max_m_s": 5.0,
            "v_min_m_s": -5.0,
            "w_max_rad_s": 5.0,
            "gate_acceleration_m_s2": 50.0,
            "gate_angular_acceleration_rad_s2": 50.0,
        }
    )
    far = {"v_max_m_s": 9.0, "w_max_rad_s": 9.0}
    bench = Bench(loose, **far)
    bench.order(9.0)
    assert bench.order(9.0).v_m_s == pytest.approx(0.006)
    assert bench.drive(9.0, steps=200).v_m_s == pytest.approx(0.6)
    assert Bench(loose, **far).drive(-9.0, steps=200).v_m_s == pytest.approx(-0.2)
    turning = Bench(loose, **far)
    turning.order(0.0, 9.0)
    assert turning.order(0.0, 9.0).w_rad_s == pytest.approx(0.025)
    assert turning.drive(0.0, 9.0, steps=200).w_rad_s == pytest.approx(0.8)


def test_configuration_lowers_the_caps() -> None:
    low = replace_limits(v_max_m_s=0.3, v_min_m_s=-0.05, w_max_rad_s=0.4)
    far = {"v_max_m_s": 9.0, "w_max_rad_s": 9.0}
    assert Bench(low, **far).drive(9.0, steps=200).v_m_s == pytest.approx(0.3)
    assert Bench(low, **far).drive(-9.0, steps=200).v_m_s == pytest.approx(-0.05)
    assert Bench(low, **far).drive(0.0, 9.0, steps=200).w_rad_s == pytest.approx(0.4)
    slow = Bench(replace_limits(gate_acceleration_m_s2=0.1, gate_angular_acceleration_rad_s2=0.5))
    slow.order(0.3)
    assert slow.order(0.3).v_m_s == pytest.approx(0.001)
    turning = Bench(replace_limits(gate_acceleration_m_s2=0.1, gate_angular_acceleration_rad_s2=0.5))
    turning.order(0.0, 0.3)
    assert turning.order(0.0, 0.3).w_rad_s == pytest.approx(0.005)


def test_a_gap_of_exactly_the_bound_is_accepted() -> None:
    assert not _beyond(0.5, 0.25)
    assert not _beyond(-0.5, -0.25)
    assert not _beyond(0.0, -9.0)


@pytest.mark.parametrize("phase", PHASES)
def test_each_phase_is_held_to_its_cap(phase: Phase) -> None:
    cap = PHASE_CAPS[phase]
    loose = {"v_max_m_s": 9.0, "w_max_rad_s": 9.0, "phase": phase}
    wide = replace_limits(v_max_m_s=0.6, w_max_rad_s=0.8)
    assert Bench(wide, **loose).drive(9.0, steps=200).v_m_s == pytest.approx(cap.v_m_s)
    assert Bench(wide, **loose).drive(0.0, 9.0, steps=200).w_rad_s == pytest.approx(cap.w_rad_s)
    both = Bench(wide, **loose).drive(cap.v_m_s, cap.w_rad_s, steps=200)
    back = Bench(replace_limits(v_min_m_s=-0.2, w_max_rad_s=0.8), **loose).drive(-0.05, cap.w_rad_s, steps=200)
    assert abs(back.v_m_s) + abs(back.w_rad_s) * TRACK / 2 <= cap.wheel_m_s + 1e-9
    wheel_m_s = abs(both.v_m_s) + abs(both.w_rad_s) * TRACK / 2
    assert wheel_m_s == pytest.approx(min(cap.wheel_m_s, cap.v_m_s + cap.w_rad_s * TRACK / 2))


def test_an_unknown_phase_stands_still() -> None:
    assert Bench(phase="party").drive(0.3).v_m_s == 0.0


@pytest.mark.parametrize(("beyond", "clipped"), [(1e-15, ()), (0.9e-9, ()), (1.1e-9, ("cap",)), (1e-3, ("cap",))])
def test_the_last_bits_of_a_command_at_its_cap_are_cut_and_are_no_intervention(
    beyond: float, clipped: tuple[str, ...]
) -> None:
    bench = Bench()
    bench.drive(0.5)
    decision = bench.order(0.5 * (1.0 + beyond))
    assert decision.v_m_s <= 0.5
    assert decision.clipped == clipped
