"""``davpc calibrate mount``: where the camera sits on the Follower, from the array seen at known poses.

The robot stands at a few measured poses before the Leader; each gives one averaged image of the LEDs. Place and
attitude of the camera are those that explain all of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from common.geometry import Array, Pose2, points_in_camera
from follower.estimator.lens import mounting_rotation

_FEWEST_POSES = 4
_ITERATIONS = 20
_STEP = 1e-6
_WORST_RESIDUAL_PX = 2.0
_LEAST_SPREAD_M = 0.5
_FEWEST_LEDS = 3
# what frames of a robot at rest must be: enough, and steady
FEWEST_FRAMES = 30
STEADY_PX = 0.5


class MountError(Exception):
    """Views from which the mounting cannot be determined; one line that names what is missing."""


@dataclass(frozen=True)
class MountView:
    """The array seen at a measured pose of {L} in {F}: features (n, 2) normalised, NaN where not seen."""

    relative: Pose2
    features: Array


@dataclass(frozen=True)
class Mount:
    """The camera's place and attitude in {F}.

    Attributes:
        xyz_m: optical centre ξ [m].
        pitch_rad, roll_rad, yaw_rad: up, right side down, to the left positive.
        sigma: (6,) standard deviations of x, y, z [m], pitch, roll, yaw [rad] by the residuals.
        residual_px: root mean square of the reprojection errors.
    """

    xyz_m: tuple[float, float, float]
    pitch_rad: float
    roll_rad: float
    yaw_rad: float
    sigma: Array
    residual_px: float


def calibrate_mount(views: Sequence[MountView], points_l: Array, start_xyz_m: Array, focal_px: float) -> Mount:
    """Fit the mounting.

    Args:
        views: at least four, over half a metre of distance or more.
        points_l: (n, 3) LEDs in {L} [m].
        start_xyz_m: ξ as measured by hand [m].
        focal_px: to express residuals in pixels.

    Raises:
        MountError: too few views, too close together, or they do not fit one mounting.
    """
    if len(views) < _FEWEST_POSES:
        raise MountError(f"{len(views)} poses, at least {_FEWEST_POSES} are needed")
    distances = [view.relative.x_m for view in views]
    if max(distances) - min(distances) < _LEAST_SPREAD_M:
        raise MountError(f"all poses lie within {max(distances) - min(distances):.2f} m: vary the distance by 0.5 m")
    state = np.array([*start_xyz_m, 0.0, 0.0, 0.0])
    for _ in range(_ITERATIONS):
        error, jacobian = _linearised(views, points_l, state)
        step, _, rank, _ = np.linalg.lstsq(jacobian, error, rcond=1e-9)
        if rank < len(state):
            raise MountError("these poses do not determine the mounting: vary distance, side and heading")
        state = state + step
        if np.abs(step).max() < 1e-9:
            break
    error, jacobian = _linearised(views, points_l, state)
    rms = float(np.sqrt(np.mean(error**2) * 2.0))
    if not rms * focal_px <= _WORST_RESIDUAL_PX:
        raise MountError(f"residual of {rms * focal_px:.1f} px: check the measured poses and leds.positions_m")
    variance = float(error @ error) / max(len(error) - len(state), 1)
    sigma = np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)) * variance)
    x, y, z, pitch, roll, yaw = (float(value) for value in state)
    return Mount((x, y, z), pitch, roll, yaw, sigma, rms * focal_px)


def project(points_l: Array, relative: Pose2, state: Array) -> Array:
    """Features of the array through a camera that sits elsewhere, and turned.

    Yaw turns first about the vertical, then pitch about the camera's x axis, then roll about its optical axis.

    Args:
        points_l: (n, 3) LEDs in {L} [m].
        relative: pose of {L} in {F}.
        state: (6,) the camera's x, y, z in {F} [m], pitch, roll, yaw [rad].

    Returns:
        (n, 2) normalised.
    """
    x, y, z = points_in_camera(points_l, relative, state[:3]).T
    (cp, cr, cy), (sp, sr, sy) = np.cos(state[3:]), np.sin(state[3:])
    x, z = x * cy + z * sy, z * cy - x * sy
    y, z = y * cp + z * sp, z * cp - y * sp
    x, y = x * cr + y * sr, y * cr - x * sr
    return np.column_stack([x / z, y / z])


def _linearised(views: Sequence[MountView], points_l: Array, state: Array) -> tuple[Array, Array]:
    """Errors (m,) of all seen coordinates and their Jacobian (m, 6), by central differences."""
    errors, rows = [], []
    for view in views:
        seen = np.isfinite(view.features).all(axis=1)
        points, measured = points_l[seen], view.features[seen]
        errors.append((measured - project(points, view.relative, state)).ravel())
        columns = [
            (project(points, view.relative, state + move) - project(points, view.relative, state - move)).ravel()
            for move in np.eye(6) * _STEP
        ]
        rows.append(np.stack(columns, axis=1) / (2 * _STEP))
    return np.concatenate(errors), np.concatenate(rows)


def whole_tilt_rad(mount: Mount, configured_rad: Array) -> Array:
    """Pitch, roll, yaw (3,) of the camera itself [rad].

    Args:
        mount: fitted to features from which the configured tilt had been taken out.
        configured_rad: that tilt, ``camera.mount_tilt``.
    """
    left_over = mounting_rotation(np.array([mount.pitch_rad, mount.roll_rad, mount.yaw_rad]))
    turn = mounting_rotation(configured_rad) @ left_over
    pitch, roll = math.asin(-turn[2, 1]), math.atan2(turn[0, 1], turn[1, 1])
    return np.array([pitch, roll, math.atan2(-turn[2, 0], turn[2, 2])])


def averaged(features: Sequence[Array], focal_px: float) -> Array:
    """Mean features (n, 2) of frames of a robot at rest; NaN for a LED that half of them do not show.

    Args:
        features: (n, 2) normalised of each frame, NaN where a LED was not seen.
        focal_px: to express movement in pixels.

    Raises:
        MountError: too few frames, fewer than three LEDs, or something moved.
    """
    stack = np.array(features)
    if len(stack) < FEWEST_FRAMES:
        raise MountError(f"{len(stack)} frames with the array, at least {FEWEST_FRAMES} are needed")
    seen = np.isfinite(stack).all(axis=2).mean(axis=0) > 0.5
    if seen.sum() < _FEWEST_LEDS:
        raise MountError(f"{seen.sum()} LEDs are seen, at least {_FEWEST_LEDS} are needed")
    spread_px = float(np.nanstd(stack[:, seen], axis=0).max()) * focal_px
    if spread_px > STEADY_PX:
        raise MountError(f"features move by {spread_px:.2f} px: robots at rest? bound {STEADY_PX} px")
    mean = np.full(stack.shape[1:], np.nan)
    mean[seen] = np.nanmean(stack[:, seen], axis=0)
    return mean
