"""θ_L^F from the homography between desired and current features, as the paper measures it.

The homography maps normalised desired features to current ones, ``H ~ R + t nᵀ / d``; its decomposition gives
up to four (R, t, n). Points in front of the camera leave two; the array's known normal decides between them,
and where both normals are near it, the predicted heading. At the goal itself t = 0 and n is undefined: there H
is a pure rotation and is read as such.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import cv2
import numpy as np

from common.geometry import Array, wrap_angle

_PURE_ROTATION = 2e-3
_THINNEST = 1e-4
_SMALLEST_SCALE = 1e-6
_FEWEST = 4
_IDENTITY = np.eye(3)
_NORMALS_ALIKE_RAD = math.radians(25.0)
Rows = list[list[float]]


def array_normal(points_l: Array) -> Array:
    """Unit normal of the array's plane in an untilted {C} at θ_L^F = 0, pointing away from the camera, (3,).

    Args:
        points_l: (n, 3) LEDs in {L} [m].
    """
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
    if not np.isfinite(current).all():
        seen = np.isfinite(current[:, 0])
        current, desired = current[seen], desired[seen]
    if len(current) < _FEWEST or _collinear(current) or _collinear(desired):
        return None
    found, _ = cv2.findHomography(desired, current, 0)
    if found is None:
        return None
    rays = desired.tolist()
    matrix = _in_front(found.tolist(), rays)
    determinant = _determinant(matrix)
    if not math.isfinite(determinant):
        return None
    scale = math.cbrt(determinant)
    if scale < _SMALLEST_SCALE:
        return None  # the plane seen from behind
    if _is_rotation(matrix, scale):
        return _heading(matrix)
    return _choose(matrix, rays, normal, predicted_theta_rad)


def route(points_l: Array) -> Callable[[Array, Array, float | None], float | None]:
    """:func:`theta_from_homography` of one array: current features, desired features, predicted θ → θ.

    Args:
        points_l: (n, 3) LEDs in {L} [m].
    """
    normal = array_normal(points_l)

    def theta(current: Array, desired: Array, predicted_theta_rad: float | None) -> float | None:
        return theta_from_homography(current, desired, normal, predicted_theta_rad)

    return theta


def _in_front(matrix: Rows, rays: list[list[float]]) -> Rows:
    """H with the sign under which it maps points before one camera to points before the other."""
    x, y, z = matrix[2]
    if sum(alpha * x + beta * y + z for alpha, beta in rays) > 0.0:
        return matrix
    return [[-value for value in row] for row in matrix]


def _determinant(matrix: Rows) -> float:
    (a, b, c), (d, e, f), (g, h, i) = matrix
    return a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)


def _is_rotation(matrix: Rows, scale: float) -> bool:
    """Whether H over its scale turns only: its columns are orthonormal."""
    columns = list(zip(*matrix, strict=True))
    for i, (a, b, c) in enumerate(columns):
        for j, (d, e, f) in enumerate(columns[: i + 1]):
            if abs((a * d + b * e + c * f) / scale**2 - (i == j)) >= _PURE_ROTATION:
                return False
    return True


def _collinear(points: Array) -> bool:
    """Whether the points' smaller principal spread vanishes."""
    rows = points.tolist()
    mean_x, mean_y = (sum(values) / len(rows) for values in zip(*rows, strict=True))
    xx = sum((x - mean_x) ** 2 for x, _ in rows)
    yy = sum((y - mean_y) ** 2 for _, y in rows)
    xy = sum((x - mean_x) * (y - mean_y) for x, y in rows)
    return bool(0.5 * (xx + yy) - math.hypot(0.5 * (xx - yy), xy) < _THINNEST**2)


def _choose(matrix: Rows, rays: list[list[float]], normal: Array, predicted: float | None) -> float | None:
    _, rotations, _, normals = cv2.decomposeHomographyMat(np.array(matrix), _IDENTITY)
    n_x, n_y, n_z = normal.tolist()
    found: list[tuple[float, float]] = []
    for rotation, candidate in zip(rotations, normals, strict=True):
        ((x,), (y,), (z,)) = candidate.tolist()
        # NaN fails the comparison too
        if not all(alpha * x + beta * y + z > 0.0 for alpha, beta in rays):
            continue
        angle = math.acos(min(max(x * n_x + y * n_y + z * n_z, -1.0), 1.0))
        found.append((angle, _heading(rotation.tolist())))
    if not found:
        return None
    found.sort()
    nearest = [theta for angle, theta in found if angle <= _NORMALS_ALIKE_RAD]
    if len(nearest) < 2 or predicted is None:
        return found[0][1]
    return min(nearest, key=lambda theta: abs(wrap_angle(theta - predicted)))


def _heading(rotation: Rows) -> float:
    """Rotation about the camera's y axis, the paper's θ_L^F; of a positive multiple of a rotation too."""
    return math.atan2(rotation[2][0] - rotation[0][2], rotation[0][0] + rotation[2][2])
