"""The hard ceilings, number by number, and what derives from them: the bounds of the configuration."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from common.ceilings import (
    HARD_ACCELERATION_M_S2,
    HARD_ANGULAR_ACCELERATION_RAD_S2,
    HARD_GRIP_TORQUE_N_M,
    HARD_JOINT_TORQUE_N_M,
    HARD_LIFT_M,
    HARD_V_MAX_M_S,
    HARD_V_MIN_M_S,
    HARD_W_MAX_RAD_S,
    HARD_WHEEL_SPEED_M_S,
    PHASE_CAPS,
)
from common.config import Config
from common.messages import PHASES

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


def test_the_ceilings_are_these() -> None:
    assert (HARD_V_MIN_M_S, HARD_V_MAX_M_S, HARD_W_MAX_RAD_S, HARD_WHEEL_SPEED_M_S) == (-0.2, 0.6, 0.8, 0.6)
    assert (HARD_ACCELERATION_M_S2, HARD_ANGULAR_ACCELERATION_RAD_S2) == (0.6, 2.5)
    assert (HARD_JOINT_TORQUE_N_M, HARD_GRIP_TORQUE_N_M, HARD_LIFT_M) == (25.0, 6.0, 1.0)


def test_each_phase_has_its_cap() -> None:
    assert set(PHASE_CAPS) == set(PHASES)
    for phase, cap in PHASE_CAPS.items():
        assert (cap.v_m_s, cap.w_rad_s, cap.wheel_m_s) == EXPECTED_CAPS.get(phase, (0.0, 0.0, 0.0)), phase


@pytest.mark.parametrize(
    ("section", "key", "ceiling"),
    [
        ("limits", "v_min_m_s", -0.2),
        ("limits", "v_max_m_s", 0.6),
        ("limits", "w_max_rad_s", 0.8),
        ("limits", "gate_acceleration_m_s2", 0.6),
        ("limits", "gate_angular_acceleration_rad_s2", 2.5),
        ("supervisor", "approach_speed_m_s", 0.6),
        ("supervisor", "insert_speed_m_s", 0.05),
        ("supervisor", "push_speed_m_s", 0.05),
        ("supervisor", "retract_speed_m_s", 0.1),
        ("supervisor", "manual_speed_m_s", 0.1),
        ("supervisor", "manual_turn_rad_s", 0.3),
        ("supervisor", "search_rate_rad_s", 0.3),
        ("follower_can", "lift_max_m", 1.0),
    ],
)
def test_configuration_can_only_lower_a_ceiling(config: Config, section: str, key: str, ceiling: float) -> None:
    configured = getattr(config, section)
    type(configured).model_validate({**configured.model_dump(), key: ceiling})
    with pytest.raises(ValidationError):
        type(configured).model_validate({**configured.model_dump(), key: ceiling * 1.001})
