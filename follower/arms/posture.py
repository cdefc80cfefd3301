"""Posture of both arms from their joint angles, and the force that their joint torques put on the handle."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from common.config import ArmsConfig
from common.geometry import Array, Pose2
from follower.arms.kinematics import Angles, ScaraArm, make_arms

_SPEED_FILTER_SHARE = 0.6
# near a stretched arm the force along it cannot be separated from joint torques
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


class PostureTracker:
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


def _halves(values: tuple[float, ...]) -> tuple[Angles, Angles]:
    a, b, c, d, e, f = values
    return (a, b, c), (d, e, f)
