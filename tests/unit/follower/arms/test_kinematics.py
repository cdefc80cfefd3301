"""Kinematics: derivative, both elbows, mirror images, and what is out of reach."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.config import Config
from common.errors import ConfigError
from common.geometry import Pose2, wrap_angle
from follower.arms.kinematics import Angles, ReachError, ScaraArm, check_postures, make_arms
from tests.rigs.arms_rig import holding_angles, joint_angles


@given(q=joint_angles, side=st.integers(0, 1))
def test_the_jacobian_is_the_derivative_of_the_gripper_pose(
    arms: tuple[ScaraArm, ScaraArm], q: Angles, side: int
) -> None:
    arm, step = arms[side], 1e-6
    for joint in range(3):
        ahead, behind = (
            arm.forward((q[0] + d * (joint == 0), q[1] + d * (joint == 1), q[2] + d * (joint == 2)))
            for d in (step, -step)
        )
        slope = (ahead.as_array() - behind.as_array()) / (2 * step)
        slope[2] = wrap_angle(ahead.theta_rad - behind.theta_rad) / (2 * step)
        assert arm.jacobian(q)[:, joint] == pytest.approx(slope, abs=1e-6)


@given(q=joint_angles.filter(lambda q: abs(q[1]) > 0.01), side=st.integers(0, 1))
def test_both_elbows_reach_the_pose_and_one_of_them_is_where_it_came_from(
    arms: tuple[ScaraArm, ScaraArm], q: Angles, side: int
) -> None:
    pose = arms[side].forward(q)
    found = arms[side].inverse(pose)
    for solution in found:
        back = arms[side].forward(solution)
        assert (back.x_m, back.y_m) == pytest.approx((pose.x_m, pose.y_m), abs=1e-9)
        assert wrap_angle(back.theta_rad - pose.theta_rad) == pytest.approx(0.0, abs=1e-9)
    assert found[0][1] < 0 < found[1][1]
    nearest = min(max(abs(wrap_angle(a - b)) for a, b in zip(q, solution, strict=True)) for solution in found)
    assert nearest < 1e-6


def test_the_right_arm_is_the_left_ones_mirror_image_and_elbows_point_outwards(config: Config) -> None:
    held = holding_angles(config)
    assert held[3:] == pytest.approx([-angle for angle in held[:3]])
    left = make_arms(config.arms)[0]
    elbow_y = left.base_xy_m[1] + left.link_m[0] * math.sin(held[0])
    assert elbow_y > max(left.base_xy_m[1], config.arms.grip_half_width_m)


def test_an_unreachable_pose_names_the_arm_and_the_reason(arms: tuple[ScaraArm, ScaraArm]) -> None:
    with pytest.raises(
        ReachError, match=r"right arm: gripper at x 0\.900 m, y -0\.200 m is out of reach: wrist 0\.7"
    ):
        arms[1].solve(Pose2(0.9, -0.2, 0.0))
    with pytest.raises(ReachError, match=r"left arm: .* needs joint 3 at .*°, its limits are -120\.0° to 120\.0°"):
        arms[0].solve(Pose2(0.30, 0.2, math.pi))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"handle_x_m": 0.70}, r"robots\.toml: arms\.handle_x_m: left arm: .* out of reach"),
        ({"retracted_x_m": -0.40}, r"robots\.toml: arms\.retracted_x_m: left arm: .* out of reach"),
        ({"joint_limits_deg": ((-5.0, 5.0), (-150.0, 10.0), (-120.0, 120.0))}, r"handle_x_m: left arm: .* joint 1"),
    ],
)
def test_arms_that_cannot_hold_the_handle_are_refused_before_anything_is_enabled(
    config: Config, change: dict[str, object], said: str
) -> None:
    broken = config.model_copy(update={"arms": config.arms.model_copy(update=change)})
    with pytest.raises(ConfigError, match=said) as refused:
        check_postures(broken.arms, "robots.toml")
    assert "\n" not in str(refused.value)
