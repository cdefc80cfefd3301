"""The gate's caps: of code, configuration, mission, wheel and phase."""

from __future__ import annotations

from typing import Any

import pytest

from common.messages import PHASES
from follower.can_bridge.gate import (
    HARD_ACCELERATION_M_S2,
    HARD_ANGULAR_ACCELERATION_RAD_S2,
    HARD_V_MAX_M_S,
    HARD_V_MIN_M_S,
    HARD_W_MAX_RAD_S,
    PHASE_CAPS,
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
def test_caps_of_configuration_mission_and_rim(
    v: float, w: float, cap: dict[str, Any], expected: tuple[float, float]
) -> None:
    decision = Bench(**cap).drive(v, w, steps=300)
    assert (decision.v_m_s, decision.w_rad_s) == pytest.approx(expected)


def test_constants_in_code_stand_above_the_configuration() -> None:
    assert (HARD_V_MAX_M_S, HARD_V_MIN_M_S, HARD_W_MAX_RAD_S) == (0.6, -0.2, 0.8)
    assert (HARD_ACCELERATION_M_S2, HARD_ANGULAR_ACCELERATION_RAD_S2) == (0.6, 2.5)
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


def test_a_gap_of_exactly_the_bound_is_borne() -> None:
    assert not _beyond(0.5, 0.25)
    assert not _beyond(-0.5, -0.25)
    assert not _beyond(0.0, -9.0)


EXPECTED_CAPS = {
    "staging": (0.10, 0.30, 0.15),
    "search": (0.0, 0.30, 0.08),
    "insert": (0.05, 0.20, 0.08),
    "acquire": (0.10, 0.30, 0.15),
    "approach": (0.60, 0.80, 0.60),
    "push": (0.05, 0.20, 0.08),
    "lock": (0.05, 0.10, 0.06),
    "retract": (0.10, 0.30, 0.15),
    "manual": (0.10, 0.30, 0.15),
}


@pytest.mark.parametrize("phase", PHASES)
def test_each_phase_has_its_cap(phase: str) -> None:
    cap = next(cap for name, cap in PHASE_CAPS.items() if name == phase)
    assert (cap.v_m_s, cap.w_rad_s, cap.wheel_m_s) == EXPECTED_CAPS.get(phase, (0.0, 0.0, 0.0))
    loose = {"v_max_m_s": 9.0, "w_max_rad_s": 9.0, "phase": phase}
    wide = replace_limits(v_max_m_s=0.6, w_max_rad_s=0.8)
    assert Bench(wide, **loose).drive(9.0, steps=200).v_m_s == pytest.approx(cap.v_m_s)
    assert Bench(wide, **loose).drive(0.0, 9.0, steps=200).w_rad_s == pytest.approx(cap.w_rad_s)
    both = Bench(wide, **loose).drive(cap.v_m_s, cap.w_rad_s, steps=200)
    back = Bench(replace_limits(v_min_m_s=-0.2, w_max_rad_s=0.8), **loose).drive(-0.05, cap.w_rad_s, steps=200)
    assert abs(back.v_m_s) + abs(back.w_rad_s) * TRACK / 2 <= cap.wheel_m_s + 1e-9
    rim = abs(both.v_m_s) + abs(both.w_rad_s) * TRACK / 2
    assert rim == pytest.approx(min(cap.wheel_m_s, cap.v_m_s + cap.w_rad_s * TRACK / 2))


def test_an_unknown_phase_stands_still() -> None:
    assert Bench(phase="party").drive(0.3).v_m_s == 0.0
