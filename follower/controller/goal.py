"""The planar pose from which features look as they do: the goal behind the paper's desired features."""

from __future__ import annotations

import numpy as np

from common.geometry import Array, Pose2, feature_jacobian, features_at

_STEPS = 30
_TOLERANCE = 1e-10


def pose_from_features(features: Array, theta_guess_rad: float, points_l: Array, camera_xyz_m: Array) -> Pose2:
    """Least-squares pose of {L} in {F}, by Gauss–Newton with step halving.

    Args:
        features: (n, 2) normalised, all seen.
        theta_guess_rad: θ_L^F to start from; x and y start from the features' depth Δh/β.

    Raises:
        ValueError: no pose before the camera explains the features.
    """
    depth = float(np.median((camera_xyz_m[2] - points_l[:, 2]) / features[:, 1]))
    if not depth > 0:
        raise ValueError("the features have no depth: β and Δh differ in sign")
    across = float(np.mean(features[:, 0])) * depth
    state = np.array([depth + camera_xyz_m[0], camera_xyz_m[1] - across, theta_guess_rad])
    error = _misfit(state, features, points_l, camera_xyz_m)
    for _ in range(_STEPS):
        jacobian = feature_jacobian(points_l, _pose(state), camera_xyz_m)
        residual = (features - features_at(points_l, _pose(state), camera_xyz_m)).reshape(-1)
        step = np.linalg.lstsq(jacobian, residual, rcond=None)[0]
        while (trial := _misfit(state + step, features, points_l, camera_xyz_m)) > error and np.abs(
            step
        ).max() > _TOLERANCE:
            step = step / 2
        state, error = state + step, trial
        if np.abs(step).max() <= _TOLERANCE:
            break
    return _pose(state)


def _misfit(state: Array, features: Array, points_l: Array, camera_xyz_m: Array) -> float:
    try:
        return float(np.sum((features - features_at(points_l, _pose(state), camera_xyz_m)) ** 2))
    except ValueError:  # a point behind the camera: worse than any misfit
        return np.inf


def _pose(state: Array) -> Pose2:
    return Pose2(float(state[0]), float(state[1]), float(state[2]))
