"""The handle held compliantly: impedance in the handle's frame, τ = Jᵀ(K e − D ẋ + F_push), within torque limits.

The plane is horizontal, so gravity does not enter. After the adaptive arm controller that the paper builds on
(section "System Overview"): the arms steer the trolley along the chassis' direction while the base moves.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from common.config import ArmsConfig
from common.geometry import Array, Pose2, wrap_angle
from follower.arms.kinematics import Angles, ScaraArm, grip_poses, make_arms

_SPEED_FILTER_SHARE = 0.6
# near a stretched arm the force along it cannot be told from joint torques
_SINGULAR = 1e-4


@dataclass(frozen=True)
class Posture:
    """Joint angles and speeds of both arms, left first, and what follows from them."""

    angles_rad: tuple[Angles, Angles]
    speeds_rad_s: tuple[Angles, Angles]
    grippers: tuple[Pose2, Pose2]
    jacobians: tuple[Array, Array]

    @property
    def handle(self) -> Pose2:
        """Pose in {F} of the middle between both grippers: where the handle is while they hold it."""
        left, right = self.grippers
        yaw = math.atan2(right.x_m - left.x_m, left.y_m - right.y_m)
        return Pose2((left.x_m + right.x_m) / 2, (left.y_m + right.y_m) / 2, yaw)


class PostureSense:
    """Postures from successive joint angles; speeds by differences."""

    def __init__(self, config: ArmsConfig) -> None:
        self.arms: tuple[ScaraArm, ScaraArm] = make_arms(config)
        self._last: tuple[tuple[float, ...], int] | None = None
        self._speeds: tuple[float, ...] = (0.0,) * 6

    def posture(self, angles_rad: tuple[float, ...], measured_ns: int) -> Posture:
        """Posture for six measured joint angles, left 1–3, right 1–3."""
        if self._last is not None and measured_ns > self._last[1]:
            elapsed_s = (measured_ns - self._last[1]) / 1e9
            self._speeds = tuple(
                speed + _SPEED_FILTER_SHARE * ((now - before) / elapsed_s - speed)
                for speed, now, before in zip(self._speeds, angles_rad, self._last[0], strict=True)
            )
        if self._last is None or measured_ns > self._last[1]:
            self._last = (angles_rad, measured_ns)
        angles, speeds = _halves(angles_rad), _halves(self._speeds)
        left, right = self.arms
        return Posture(
            angles,
            speeds,
            (left.forward(angles[0]), right.forward(angles[1])),
            (left.jacobian(angles[0]), right.jacobian(angles[1])),
        )


def handle_force(posture: Posture, torques_n_m: tuple[float, ...]) -> Array:
    """Force [N] (x, y in {F}) on the handle from all six joint torques: Σ J⁻ᵀ τ, without the wrists' moments.

    A gripper's moment acts on all three joints alike, so that the differences of their torques hold the force.
    """
    total = np.zeros(2)
    for jacobian, (first, second, third) in zip(posture.jacobians, _halves(torques_n_m), strict=True):
        (x1, x2, x3), (y1, y2, y3), _ = jacobian.tolist()
        determinant = (x1 - x3) * (y2 - y3) - (x2 - x3) * (y1 - y3)
        if abs(determinant) > _SINGULAR:
            upper, lower = first - third, second - third
            total[0] += (upper * (y2 - y3) - lower * (y1 - y3)) / determinant
            total[1] += ((x1 - x3) * lower - (x2 - x3) * upper) / determinant
    return total


class HandleImpedance:
    """Joint torques that pull both grippers to their places on a reference handle."""

    def __init__(self, config: ArmsConfig) -> None:
        self._config = config
        self._held = np.array(config.held_stiffness), np.array(config.held_damping)
        self._free = np.array(config.free_stiffness), np.array(config.free_damping)

    def torques(self, posture: Posture, reference: Pose2, push_n: float, firmness: float) -> tuple[float, ...]:
        """Six joint torques [N·m].

        Args:
            posture: of both arms.
            reference: handle in {F}.
            push_n: force along the chassis' x, shared by both arms.
            firmness: 0 takes the gains of free arms, 1 those of arms that hold a trolley.
        """
        stiffness, damping = (
            free + firmness * (held - free) for held, free in zip(self._held, self._free, strict=True)
        )
        rotation = _rotation(posture.handle.theta_rad if firmness > 0.0 else reference.theta_rad)
        wanted = grip_poses(reference, self._config.grip_half_width_m)
        result: list[float] = []
        for goal, gripper, jacobian, speeds in zip(
            wanted, posture.grippers, posture.jacobians, posture.speeds_rad_s, strict=True
        ):
            error = goal.as_array() - gripper.as_array()
            error[2] = wrap_angle(float(error[2]))
            velocity = jacobian @ np.array(speeds)
            wrench = rotation @ (stiffness * (rotation.T @ error) - damping * (rotation.T @ velocity))
            wrench[0] += push_n / 2
            result += self._within_limit(jacobian.T @ wrench)
        return tuple(result)

    def _within_limit(self, torques: Array) -> list[float]:
        """Scaled together, so that the force at the gripper keeps its direction."""
        worst = float(np.abs(torques).max())
        limit = self._config.joint_torque_limit_n_m
        scale = limit / worst if worst > limit else 1.0
        return [max(-limit, min(limit, float(scale * torque))) for torque in torques]


def _rotation(angle_rad: float) -> Array:
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _halves(values: tuple[float, ...]) -> tuple[Angles, Angles]:
    a, b, c, d, e, f = values
    return (a, b, c), (d, e, f)
