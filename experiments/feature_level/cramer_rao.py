"""The information limit of a run: what no unbiased estimator of the relative pose can beat."""

from __future__ import annotations

import math

import numpy as np

from common.geometry import Array, Pose2, move_relative
from experiments.feature_level.scenes import FRAME_RATE_HZ, FRAMES_PER_COMMAND, NOISE_THETA_RAD
from experiments.feature_level.task import Task
from experiments.feature_level.trial import FlightTrace
from follower.model.array import feature_jacobian

MEAN_ABSOLUTE = math.sqrt(2 / math.pi)  # of a Gaussian, in standard deviations


def bound(task: Task, trace: FlightTrace) -> dict[str, float]:
    """Mean errors |e| at the end of a run by an estimator that knows every input exactly and starts from nothing.

    Information adds up over all frames in which features are in view and is carried along the true path.
    """
    frame_s = 1.0 / FRAME_RATE_HZ
    information = 1e-9 * np.eye(3)
    relative = Pose2(0.0, 0.0, 0.0)
    for place, (v, w), pixels in zip(trace.pose, trace.command, trace.features, strict=True):
        relative = Pose2(*place).inverse()
        inside = np.repeat(_inside(task, pixels), 2)
        for _ in range(FRAMES_PER_COMMAND):
            slopes = feature_jacobian(task.points_l, relative, task.camera)[inside] / task.sigma
            information = information + slopes.T @ slopes
            information[2, 2] += 1.0 / NOISE_THETA_RAD**2
            relative = move_relative(relative, v, w, frame_s)
            back = _backward(w * frame_s)
            information = back.T @ information @ back
    covariance = np.linalg.inv(information)
    c, s = math.cos(relative.theta_rad), math.sin(relative.theta_rad)
    to_leader = -np.array(
        [
            [c, s, c * relative.y_m - s * relative.x_m],
            [-s, c, -s * relative.y_m - c * relative.x_m],
            [0.0, 0.0, 1.0],
        ]
    )
    sigma = np.sqrt(np.diag(to_leader @ covariance @ to_leader.T))
    pixels = (
        feature_jacobian(task.points_l, task.goal_leader_in_follower, task.camera) * task.config.camera.lens.fx_px
    )
    e_p = math.sqrt(np.trace(pixels @ covariance @ pixels.T) / len(task.points_l))
    return {
        "e_x_cm": 100 * MEAN_ABSOLUTE * float(sigma[0]),
        "e_y_cm": 100 * MEAN_ABSOLUTE * float(sigma[1]),
        "e_theta_deg": math.degrees(MEAN_ABSOLUTE * float(sigma[2])),
        "e_p_px": e_p,
    }


def _backward(turn_rad: float) -> Array:
    """∂(pose before)/∂(pose after) of one step of eq. (2), the relative motion; the distance does not enter."""
    c, s = math.cos(turn_rad), math.sin(turn_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _inside(task: Task, pixels: Array) -> Array:
    size = np.array([task.config.camera.width_px - 1, task.config.camera.height_px - 1])
    inside: Array = np.all((pixels >= 0) & (pixels <= size), axis=1)
    return inside
