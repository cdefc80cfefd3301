"""Planar kinematics of a SCARA arm with three revolute joints, in {F}: textbook 3R, angles counter-clockwise."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from common.config import ArmsConfig
from common.errors import ConfigError
from common.geometry import Array, Pose2, wrap_angle

Side = Literal["left", "right"]
Angles = tuple[float, float, float]
_LIMIT_SLACK_RAD = 1e-9


class ReachError(ValueError):
    """A gripper pose that an arm cannot take; the text names the arm and the reason."""


@dataclass(frozen=True)
class ScaraArm:
    """One arm: joint 1 at ``base_xy_m`` in {F}, then upper arm, forearm, wrist to grip [m]; limits [rad].

    ``elbow`` is the branch that :meth:`solve` takes: the sign of joint 2.
    """

    side: Side
    base_xy_m: tuple[float, float]
    link_m: tuple[float, float, float]
    limits_rad: tuple[tuple[float, float], ...]
    elbow: int

    def forward(self, angles_rad: Angles) -> Pose2:
        """Gripper pose in {F}."""
        x_m, y_m = self.base_xy_m
        heading = 0.0
        for length, angle in zip(self.link_m, angles_rad, strict=True):
            heading += angle
            x_m += length * math.cos(heading)
            y_m += length * math.sin(heading)
        return Pose2(x_m, y_m, wrap_angle(heading))

    def jacobian(self, angles_rad: Angles) -> Array:
        """∂(x, y, φ) of the gripper by the joint angles, (3, 3)."""
        first, second, third = angles_rad[0], angles_rad[0] + angles_rad[1], sum(angles_rad)
        (l1, l2, l3) = self.link_m
        # joint i turns everything from link i on
        x3, y3 = l3 * math.cos(third), l3 * math.sin(third)
        x2, y2 = x3 + l2 * math.cos(second), y3 + l2 * math.sin(second)
        x1, y1 = x2 + l1 * math.cos(first), y2 + l1 * math.sin(first)
        return np.array([[-y1, -y2, -y3], [x1, x2, x3], [1.0, 1.0, 1.0]])

    def inverse(self, gripper: Pose2) -> tuple[Angles, Angles]:
        """Joint angles for a gripper pose in {F}, elbow to the left (joint 2 < 0) first; limits not yet checked.

        Raises:
            ReachError: the wrist would lie beyond or inside the reach of the first two links.
        """
        l1, l2, l3 = self.link_m
        ahead = gripper.x_m - l3 * math.cos(gripper.theta_rad) - self.base_xy_m[0]
        aside = gripper.y_m - l3 * math.sin(gripper.theta_rad) - self.base_xy_m[1]
        distance = math.hypot(ahead, aside)
        if not abs(l1 - l2) <= distance <= l1 + l2:
            raise ReachError(
                f"{self.side} arm: gripper at x {gripper.x_m:.3f} m, y {gripper.y_m:.3f} m is out of reach: "
                f"wrist {distance:.3f} m from the shoulder, within {abs(l1 - l2):.3f} to {l1 + l2:.3f} m"
            )
        bend = math.acos(max(-1.0, min(1.0, (distance**2 - l1**2 - l2**2) / (2 * l1 * l2))))
        left, right = (self._branch(gripper, ahead, aside, sign * bend) for sign in (-1.0, 1.0))
        return left, right

    def solve(self, gripper: Pose2) -> Angles:
        """Joint angles of the arm's own branch.

        Raises:
            ReachError: out of reach, or beyond a joint's limit.
        """
        angles = self.inverse(gripper)[self.elbow > 0]
        for number, (angle, (low, high)) in enumerate(zip(angles, self.limits_rad, strict=True), start=1):
            if not low - _LIMIT_SLACK_RAD <= angle <= high + _LIMIT_SLACK_RAD:
                raise ReachError(
                    f"{self.side} arm: gripper at x {gripper.x_m:.3f} m, y {gripper.y_m:.3f} m needs joint {number} "
                    f"at {math.degrees(angle):.1f}°, its limits are {math.degrees(low):.1f}° to "
                    f"{math.degrees(high):.1f}°"
                )
        return angles

    def _branch(self, gripper: Pose2, ahead_m: float, aside_m: float, second: float) -> Angles:
        l1, l2, _ = self.link_m
        lean = math.atan2(l2 * math.sin(second), l1 + l2 * math.cos(second))
        first = wrap_angle(math.atan2(aside_m, ahead_m) - lean)
        return first, second, wrap_angle(gripper.theta_rad - first - second)


def make_arms(config: ArmsConfig) -> tuple[ScaraArm, ScaraArm]:
    """The left and the right arm; each bends its elbow outwards."""
    (x_m, y_m), limits = config.base_xy_m, [(math.radians(a), math.radians(b)) for a, b in config.joint_limits_deg]
    left = ScaraArm("left", (x_m, y_m), config.link_m, tuple(limits), elbow=-1)
    right = ScaraArm("right", (x_m, -y_m), config.link_m, tuple((-b, -a) for a, b in limits), elbow=1)
    return left, right


def grip_poses(handle: Pose2, half_width_m: float) -> tuple[Pose2, Pose2]:
    """Poses of the left and right gripper on a handle, both in the handle's outer frame."""
    return handle.compose(Pose2(0.0, half_width_m, 0.0)), handle.compose(Pose2(0.0, -half_width_m, 0.0))


def check_postures(config: ArmsConfig, origin: str) -> None:
    """Both arms must reach the handle where it is held, and the retracted posture.

    Raises:
        ConfigError: naming the key, the arm and the reason.
    """
    for key, x_m in (("handle_x_m", config.handle_x_m), ("retracted_x_m", config.retracted_x_m)):
        poses = grip_poses(Pose2(x_m, 0.0, 0.0), config.grip_half_width_m)
        for arm, pose in zip(make_arms(config), poses, strict=True):
            try:
                arm.solve(pose)
            except ReachError as error:
                raise ConfigError(f"{origin}: arms.{key}: {error}") from error
