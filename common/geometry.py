"""Frames, rigid transforms, projection and the interaction matrix, each with its equation in the paper.

Frames (docs: ARCHITECTURE.md): {F} Follower, {L} Leader, {C} camera, {I} normalised image, {Π} pixels.
A relative pose is the pose of {L} in {F}: ``(x_L^F [m], y_L^F [m], θ_L^F [rad])``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Pose2:
    """A planar pose: x [m], y [m], heading θ [rad], counter-clockwise positive."""

    x_m: float
    y_m: float
    theta_rad: float

    def inverse(self) -> Pose2:
        """The pose of the outer frame seen from the inner one."""
        c, s = math.cos(self.theta_rad), math.sin(self.theta_rad)
        return Pose2(-c * self.x_m - s * self.y_m, s * self.x_m - c * self.y_m, wrap_angle(-self.theta_rad))

    def compose(self, inner: Pose2) -> Pose2:
        """``a_from_b.compose(b_from_c)`` is ``a_from_c``."""
        c, s = math.cos(self.theta_rad), math.sin(self.theta_rad)
        return Pose2(
            self.x_m + c * inner.x_m - s * inner.y_m,
            self.y_m + s * inner.x_m + c * inner.y_m,
            wrap_angle(self.theta_rad + inner.theta_rad),
        )

    def as_array(self) -> Array:
        """``[x, y, θ]``."""
        return np.array([self.x_m, self.y_m, self.theta_rad])


def wrap_angle(angle_rad: float) -> float:
    """The same angle in (−π, π]."""
    return -((math.pi - angle_rad) % (2 * math.pi) - math.pi)


def pose_from_paper_start(x_m: float, y_m: float, theta_rad: float) -> Pose2:
    """Follower pose in {L} for a start as the paper prints it: x is the distance *behind* the Leader."""
    return Pose2(-x_m, y_m, theta_rad)


def points_in_camera(points_l: Array, relative: Pose2, camera_xyz_m: Array) -> Array:
    """Points of {L} in {C}: eq. (4), the rigid transform.

    Args:
        points_l: (n, 3) coordinates in {L} [m].
        relative: pose of {L} in {F}.
        camera_xyz_m: ξ, the camera's optical centre in {F} [m].

    Returns:
        (n, 3) coordinates ``[X, Y, Z]`` in {C} [m]: z along the optical axis, x right, y down.
    """
    c, s = math.cos(relative.theta_rad), math.sin(relative.theta_rad)
    x_l, y_l, z_l = points_l[:, 0], points_l[:, 1], points_l[:, 2]
    points_c = np.empty((len(points_l), 3))
    points_c[:, 0] = -relative.y_m + camera_xyz_m[1] - x_l * s - y_l * c
    points_c[:, 1] = camera_xyz_m[2] - z_l
    points_c[:, 2] = relative.x_m - camera_xyz_m[0] + x_l * c - y_l * s
    return points_c


def normalise(points_c: Array) -> Array:
    """Normalised image coordinates ``s = [α, β]``, (n, 2): eq. (7), division by depth.

    Args:
        points_c: (n, 3) in {C} [m].

    Raises:
        ValueError: a point lies on or behind the image plane.
    """
    if np.any(points_c[:, 2] <= 0.0):
        raise ValueError("a point behind the camera has no image")
    normalised: Array = points_c[:, :2] / points_c[:, 2:]
    return normalised


def features_at(points_l: Array, relative: Pose2, camera_xyz_m: Array) -> Array:
    """Normalised features (n, 2) of an array seen from a pose.

    Args:
        points_l: (n, 3) in {L} [m].
        relative: pose of {L} in {F}.
        camera_xyz_m: ξ in {F} [m].
    """
    return normalise(points_in_camera(points_l, relative, camera_xyz_m))


def interaction_matrix(features: Array, height_difference_m: Array, camera_xyz_m: Array) -> Array:
    """Interaction matrix J_s of n points, (n, 2, 2), in ds/dt = J_s u_F: eq. (10).

    Args:
        features: (n, 2) normalised coordinates ``[α, β]``.
        height_difference_m: (n,) Δh = Z_C − Z_P per point, not zero; negative for LEDs above the camera.
        camera_xyz_m: ξ in {F} [m]; its x and y are the paper's t_x, t_y.
    """
    alpha, beta = features[:, 0], features[:, 1]
    t_x, t_y = camera_xyz_m[0], camera_xyz_m[1]
    inverse_depth = beta / height_difference_m
    rows = np.empty((len(features), 2, 2))
    rows[:, 0, 0] = alpha * inverse_depth
    rows[:, 0, 1] = 1.0 + alpha**2 + inverse_depth * (t_x - alpha * t_y)
    rows[:, 1, 0] = beta * inverse_depth
    rows[:, 1, 1] = alpha * beta - beta * inverse_depth * t_y
    return rows


def extended_interaction_matrix(features: Array, height_difference_m: Array, camera_xyz_m: Array) -> Array:
    """Extended image Jacobian J_x, eq. (13), (2n+1, 2), of the state ``[s_0 … s_{n−1}, θ_L^F]``; J_θ = [0, −1].

    Args:
        features: (n, 2) normalised.
        height_difference_m: (n,) Δh = Z_C − Z_P per point.
        camera_xyz_m: ξ in {F} [m].
    """
    stacked = interaction_matrix(features, height_difference_m, camera_xyz_m).reshape(-1, 2)
    return np.vstack([stacked, [0.0, -1.0]])


def move_relative(relative: Pose2, v_m_s: float, w_rad_s: float, duration_s: float) -> Pose2:
    """Pose of {L} in {F} after the Follower drove a constant twist: eq. (2), the relative motion, solved exactly.

    Args:
        relative: pose of {L} in {F} before.
        v_m_s: speed.
        w_rad_s: turn rate.
        duration_s: for how long; negative goes back.
    """
    turn = w_rad_s * duration_s
    # chord of the arc driven in the old {F}, finite for w → 0
    half = turn / 2
    chord = v_m_s * duration_s * (math.sin(half) / half if half else 1.0)
    moved = Pose2(chord * math.cos(half), chord * math.sin(half), turn)
    return moved.inverse().compose(relative)


def mirror_deviation_m(points_l: Array) -> float:
    """How far an array differs from its own left-right mirror image, laid over it as well as a turn below 90° can.

    A pane of glass beside the approach shows the mirror image; one that equals it cannot be distinguished from it.

    Args:
        points_l: (n, 3) in {L} [m].

    Returns:
        The largest distance of a mirrored LED from its nearest LED [m], for the best placement.
    """
    mirrored = points_l * [1.0, -1.0, 1.0]
    a, b = int(np.argmin(points_l[:, 1])), int(np.argmax(points_l[:, 1]))
    span = mirrored[b, :2] - mirrored[a, :2]
    best = math.inf
    for i, j in np.ndindex(len(points_l), len(points_l)):
        target = points_l[j, :2] - points_l[i, :2]
        turn = wrap_angle(math.atan2(target[1], target[0]) - math.atan2(span[1], span[0]))
        if i == j or abs(turn) >= math.pi / 2:
            continue
        c, s = math.cos(turn), math.sin(turn)
        turned = mirrored[:, :2] @ np.array([[c, s], [-s, c]])
        shift = 0.5 * (points_l[i, :2] + points_l[j, :2] - turned[a] - turned[b])
        placed = np.column_stack([turned + shift, mirrored[:, 2]])
        distance = np.linalg.norm(placed[:, None] - points_l[None], axis=2)
        best = min(best, float(distance.min(axis=1).max()))
    return best


@dataclass(frozen=True)
class Pinhole:
    """Pinhole intrinsics K: focal lengths and principal point [px], image size [px]: eq. (6)."""

    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    width_px: int
    height_px: int

    def matrix(self) -> Array:
        """K, (3, 3)."""
        return np.array([[self.fx_px, 0.0, self.cx_px], [0.0, self.fy_px, self.cy_px], [0.0, 0.0, 1.0]])

    def to_pixels(self, normalised: Array) -> Array:
        """{I} → {Π}, (n, 2) [px]; the centre of the first pixel is (0, 0).

        Args:
            normalised: (n, 2).
        """
        return normalised * [self.fx_px, self.fy_px] + [self.cx_px, self.cy_px]

    def to_normalised(self, pixels: Array) -> Array:
        """{Π} → {I}, (n, 2).

        Args:
            pixels: (n, 2) [px].
        """
        normalised: Array = (pixels - [self.cx_px, self.cy_px]) / [self.fx_px, self.fy_px]
        return normalised
