"""The first pose of a run, from one frame's features and θ together."""

from __future__ import annotations

import numpy as np

from common.geometry import Array, Pose2, features_at
from follower.model.array import feature_jacobian

_MOST_STEPS = 20
_CONVERGED = 1e-4
_NEAREST_M = 0.8
_MAX_STEP = np.array([1.0, 1.0, 0.3])


def fit_start(
    features: Array, theta_rad: float, points_l: Array, camera_xyz_m: Array, sigma: float, sigma_theta_rad: float
) -> tuple[Pose2, Array]:
    """Weighted least squares by Gauss–Newton: pose of {L} in {F} and its covariance (3, 3).

    Args:
        features: (n, 2) normalised, NaN for what was not seen; θ decides between the plane's two poses.
        sigma: of a normalised coordinate; ``sigma_theta_rad`` of θ.
    """
    seen = np.isfinite(features[:, 0])
    points, features = points_l[seen], features[seen]
    inverse_depth = np.median(features[:, 1] / (camera_xyz_m[2] - points[:, 2]))
    depth = 1.0 / max(float(inverse_depth), 0.1)
    state = np.array([depth + camera_xyz_m[0], camera_xyz_m[1] - features[:, 0].mean() * depth, theta_rad])
    for _ in range(_MOST_STEPS):
        pose = Pose2(*state)
        residual = np.append((features - features_at(points, pose, camera_xyz_m)).reshape(-1) / sigma, 0.0)
        residual[-1] = (theta_rad - pose.theta_rad) / sigma_theta_rad
        slopes = np.vstack([feature_jacobian(points, pose, camera_xyz_m) / sigma, [0, 0, 1 / sigma_theta_rad]])
        information = slopes.T @ slopes
        step = np.linalg.solve(information, slopes.T @ residual)
        state = state + np.clip(step, -_MAX_STEP, _MAX_STEP)
        state[0] = max(state[0], camera_xyz_m[0] + _NEAREST_M)  # nearer, the array would be behind the camera
        if np.abs(step).max() < _CONVERGED:
            break
    return Pose2(*(float(value) for value in state)), np.linalg.inv(information)
