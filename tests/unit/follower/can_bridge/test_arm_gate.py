"""The arms' part of the gate."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.messages import ArmSetpoint
from follower.can_bridge.arm_gate import ArmDecision, ArmGate, ArmMeasurement, StampedArms
from tests.rigs.canbus_rig import stepped_config

MS = 1_000_000
NOW = 5_000 * MS
CONFIG = stepped_config().follower_can
STILL = ArmMeasurement(measured_ns=NOW, angles_rad=(0.0,) * 8)


def arms(
    joints: tuple[float, ...] = (3.0,) * 6, grips: tuple[float, float] = (2.0, 2.0), stamp_ns: int = NOW, **other: Any
) -> StampedArms:
    setpoint = ArmSetpoint(other.get("epoch", 7), joints, grips, other.get("lift_m", 0.2))
    return StampedArms(setpoint=setpoint, stamp_ns=stamp_ns, boot_id=other.get("boot_id", "boot"))


def step(newest: StampedArms | None, epoch: int = 7) -> ArmDecision:
    return ArmGate(CONFIG, "boot").step(NOW, newest, epoch, STILL)


def test_passes_what_is_within_the_limits() -> None:
    decision = step(arms())
    assert decision == ArmDecision(
        joint_torque_n_m=(3.0,) * 6, grip_torque_n_m=(2.0, 2.0), lift_m=0.2, rule="", clipped=()
    )


@pytest.mark.parametrize(
    ("newest", "rule"),
    [
        (None, "arm_setpoint_age"),
        (arms(stamp_ns=NOW - 100 * MS), ""),
        (arms(stamp_ns=NOW - 100 * MS - 1), "arm_setpoint_age"),
        (arms(stamp_ns=NOW + 1), "arm_setpoint_age"),
        (arms(boot_id="other"), "arm_setpoint_age"),
        (arms(epoch=6), "arm_epoch"),
    ],
)
def test_passes_nothing_that_is_not_genuine(newest: StampedArms | None, rule: str) -> None:
    decision = step(newest)
    assert decision.rule == rule
    if rule:
        assert decision == ArmDecision(
            joint_torque_n_m=(0.0,) * 6, grip_torque_n_m=(0.0, 0.0), lift_m=None, rule=rule, clipped=()
        )


@pytest.mark.parametrize("field", ["joint_torque_n_m", "grip_torque_n_m", "lift_m"])
def test_drops_what_is_not_finite(field: str) -> None:
    newest = arms()
    size = {"joint_torque_n_m": 6, "grip_torque_n_m": 2}.get(field, 0)
    object.__setattr__(newest.setpoint, field, (math.nan,) * size if size else math.inf)
    assert step(newest).rule == "arm_not_finite"


def test_caps_torques_at_what_a_drive_may_give() -> None:
    decision = step(arms((900.0, -900.0, 1.0, 1.0, 1.0, 1.0), (50.0, -50.0), lift_m=2.0))
    assert decision.joint_torque_n_m == (25.0, -25.0, 1.0, 1.0, 1.0, 1.0)
    assert decision.grip_torque_n_m == (6.0, -6.0)
    assert decision.lift_m == 0.5, "the lift's own travel, below the constant of 1 m"
    assert decision.clipped == ("arm_torque",)
    weak = tuple(joint.model_copy(update={"max_torque_permille": 100}) for joint in CONFIG.joints)
    gate = ArmGate(CONFIG.model_copy(update={"joints": weak}), "boot")
    assert gate.step(NOW, arms((5.0,) * 6), 7, STILL).joint_torque_n_m == (2.5,) * 6


@pytest.mark.parametrize(("speed", "kept"), [(1.4, 3.0), (1.6, 0.0), (-1.6, 3.0)])
def test_does_not_push_a_joint_that_is_too_fast(speed: float, kept: float) -> None:
    gate = ArmGate(CONFIG, "boot")
    gate.step(NOW, arms(), 7, STILL)
    moved = ArmMeasurement(measured_ns=NOW + 10 * MS, angles_rad=(speed * 0.01, *(0.0,) * 7))
    for _ in range(2):
        decision = gate.step(NOW + 10 * MS, arms(), 7, moved)
        assert decision.joint_torque_n_m == (kept, *(3.0,) * 5)
        assert decision.clipped == (("arm_speed",) if kept == 0.0 else ())


def test_a_lost_encoder_passes_nothing() -> None:
    gate = ArmGate(CONFIG, "boot")
    gate.step(NOW, arms(), 7, STILL)
    lost = ArmMeasurement(measured_ns=NOW + 10 * MS, angles_rad=(math.nan, *(0.0,) * 7))
    assert gate.step(NOW + 10 * MS, arms(), 7, lost).rule == "arm_not_measured"


@pytest.mark.parametrize(
    ("joint", "step_rad", "after_ms", "rule"),
    [
        (0, 0.201, 10, "arm_jump"),
        (5, -0.201, 50, "arm_jump"),
        (3, 0.199, 10, ""),
        (3, 0.201, 51, ""),
        (6, 0.5, 10, ""),
    ],
)
def test_a_joint_whose_angle_jumps_passes_nothing(joint: int, step_rad: float, after_ms: int, rule: str) -> None:
    gate = ArmGate(CONFIG, "boot")
    gate.step(NOW, arms(), 7, STILL)
    angles = [0.0] * 8
    angles[joint] = step_rad
    later = NOW + after_ms * MS
    for _ in range(2):
        assert (
            gate.step(
                later, arms(stamp_ns=later), 7, ArmMeasurement(measured_ns=later, angles_rad=tuple(angles))
            ).rule
            == rule
        )
    settled = ArmMeasurement(measured_ns=later + 10 * MS, angles_rad=tuple(angles))
    assert gate.step(later + 10 * MS, arms(stamp_ns=later), 7, settled).rule == ""


@given(
    st.lists(st.floats(-1000.0, 1000.0), min_size=8, max_size=8),
    st.lists(st.floats(-10.0, 10.0), min_size=8, max_size=8),
)
def test_whatever_is_asked_stays_within_the_caps(torques: list[float], angles: list[float]) -> None:
    gate = ArmGate(CONFIG, "boot")
    gate.step(NOW, None, 7, STILL)
    newest = arms(tuple(torques[:6]), (torques[6], torques[7]))
    decision = gate.step(NOW, newest, 7, ArmMeasurement(measured_ns=NOW + MS, angles_rad=tuple(angles)))
    given_out = (*decision.joint_torque_n_m, *decision.grip_torque_n_m)
    for torque, asked, angle, cap in zip(given_out, torques, angles, (25.0,) * 6 + (6.0,) * 2, strict=True):
        assert abs(torque) <= min(cap, abs(asked))
        assert torque * asked >= 0.0
        assert torque == 0.0 or abs(angle) <= 0.004 or torque * angle <= 0.0
