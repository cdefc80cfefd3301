"""θ_L^F from the homography between desired and current features, as the paper measures it.

The homography maps normalised desired features to current ones, ``H ~ R + t nᵀ / d``; its decomposition gives
up to four (R, t, n). Points in front of the camera leave two; the array's known normal decides between them,
and where both normals are near it, the predicted heading. At the goal itself t = 0 and n is undefined: there H
is a pure rotation and is read as such.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from common.geometry import Array, wrap_angle

_PURE_ROTATION = 2e-3
_THINNEST = 1e-4
_SMALLEST_SCALE = 1e-6
_IDENTITY = np.eye(3)
_NORMALS_ALIKE_RAD = math.radians(25.0)


def array_normal(points_l: Array) -> Array:
    """Unit normal of the array's plane in an untilted {C} at θ_L^F = 0, pointing away from the camera, (3,)."""
    centred = points_l - points_l.mean(axis=0)
    normal_l = np.linalg.svd(centred)[2][2]
    normal = np.array([-normal_l[1], -normal_l[2], normal_l[0]])
    return normal if normal[2] >= 0.0 else -normal


def theta_from_homography(
    current: Array, desired: Array, normal: Array, predicted_theta_rad: float | None
) -> float | None:
    """Relative heading θ_L^F [rad] that the homography gives.

    Args:
        current: (n, 2) normalised features, n ≥ 4, rows with NaN are left out.
        desired: (n, 2) normalised features at the goal, where θ_L^F = 0.
        normal: the array's normal at the goal, from :func:`array_normal`.
        predicted_theta_rad: heading to be near where two solutions look alike; None: nearest normal.

    Returns:
        None where fewer than four features are seen, they are degenerate, the plane is seen from behind, or no
        solution has every LED in front of the camera.
    """
    seen = np.isfinite(current[:, 0])
    if seen.sum() < 4 or _collinear(current[seen]) or _collinear(desired[seen]):
        return None
    matrix, _ = cv2.findHomography(desired[seen], current[seen], 0)
    if matrix is None or not np.isfinite(matrix).all():
        return None
    signed = _in_front(np.asarray(matrix, dtype=np.float64), desired[seen])
    scale = math.cbrt(float(np.linalg.det(signed)))
    if scale < _SMALLEST_SCALE:
        return None  # the plane seen from behind
    if np.abs(signed.T @ signed / scale**2 - _IDENTITY).max() < _PURE_ROTATION:
        return _heading(signed / scale)
    return _choose(signed, desired[seen], normal, predicted_theta_rad)


def _in_front(matrix: Array, desired: Array) -> Array:
    """H with the sign under which it maps points before one camera to points before the other."""
    mapped = desired @ matrix[2, :2] + matrix[2, 2]
    return matrix if float(mapped.sum()) > 0.0 else -matrix


def _collinear(points: Array) -> bool:
    """Whether the points' smaller principal spread vanishes."""
    rows = points.tolist()
    mean_x, mean_y = (sum(values) / len(rows) for values in zip(*rows, strict=True))
    xx = sum((x - mean_x) ** 2 for x, _ in rows)
    yy = sum((y - mean_y) ** 2 for _, y in rows)
    xy = sum((x - mean_x) * (y - mean_y) for x, y in rows)
    return bool(0.5 * (xx + yy) - math.hypot(0.5 * (xx - yy), xy) < _THINNEST**2)


def _choose(matrix: Array, desired: Array, normal: Array, predicted: float | None) -> float | None:
    _, rotations, _, normals = cv2.decomposeHomographyMat(matrix, _IDENTITY)
    rays = desired.tolist()
    n_x, n_y, n_z = normal.tolist()
    found: list[tuple[float, float]] = []
    for rotation, candidate in zip(rotations, normals, strict=True):
        x, y, z = candidate.ravel().tolist()
        # NaN fails the comparison too
        if not all(alpha * x + beta * y + z > 0.0 for alpha, beta in rays):
            continue
        angle = math.acos(min(max(x * n_x + y * n_y + z * n_z, -1.0), 1.0))
        found.append((angle, _heading(np.asarray(rotation, dtype=np.float64))))
    if not found:
        return None
    found.sort()
    nearest = [theta for angle, theta in found if angle <= _NORMALS_ALIKE_RAD]
    if len(nearest) < 2 or predicted is None:
        return found[0][1]
    return min(nearest, key=lambda theta: abs(wrap_angle(theta - predicted)))


def _heading(rotation: Array) -> float:
    """Rotation about the camera's y axis, the paper's θ_L^F."""
    return math.atan2(rotation[2, 0] - rotation[0, 2], rotation[0, 0] + rotation[2, 2])
