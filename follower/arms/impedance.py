"""The handle held compliantly: impedance in the handle's frame, τ = Jᵀ(K e − D ẋ + F_push), within torque limits.

The plane is horizontal, so gravity does not enter. After the adaptive arm controller that the paper builds on
(section "System Overview"): the arms steer the trolley along the chassis' direction while the base moves.
"""

from __future__ import annotations

import math

import numpy as np

from common.config import ArmsConfig
from common.geometry import Array, Pose2, wrap_angle
from follower.arms.kinematics import grip_poses
from follower.arms.posture import Posture


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
