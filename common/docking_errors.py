"""How far the Follower stands from its goal: the paper's E_p, signed, in the frame of the Leader, and its E_s."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from common.config import Config
from common.geometry import Pose2, features_at, wrap_angle


@dataclass(frozen=True, kw_only=True)
class DockingError:
    """Error of the pose of {F} in {L}, signed as the paper counts a start: x behind the Leader, y to its left.

    Attributes:
        e_x_m: normal error [m]; positive where the Follower stands too far behind the Leader.
        e_y_m: lateral error [m]; positive where it stands too far left.
        e_theta_rad: heading error in (−π, π] [rad]; positive where it is turned too far left.
    """

    e_x_m: float
    e_y_m: float
    e_theta_rad: float

    @property
    def e_theta_deg(self) -> float:
        """The heading error [deg]."""
        return math.degrees(self.e_theta_rad)


def docked_error(follower_in_leader: Pose2, goal_leader_in_follower: Pose2) -> DockingError:
    """Error of a pose against its goal.

    Args:
        follower_in_leader: pose of {F} in {L}: the truth of a simulation; an estimate of {L} in {F} inverted.
        goal_leader_in_follower: goal as ``docking.goal(trolley)`` gives it, the pose of {L} in {F}.
    """
    goal = goal_leader_in_follower.inverse()
    return DockingError(
        e_x_m=goal.x_m - follower_in_leader.x_m,
        e_y_m=follower_in_leader.y_m - goal.y_m,
        e_theta_rad=wrap_angle(follower_in_leader.theta_rad - goal.theta_rad),
    )


def paper_errors(follower_in_leader: Pose2, goal_leader_in_follower: Pose2, config: Config) -> dict[str, float]:
    """The paper's table columns: magnitudes of E_p in cm and degrees, and E_s in pixels.

    Args:
        follower_in_leader: pose of {F} in {L}.
        goal_leader_in_follower: goal, the pose of {L} in {F}.
        config: of the array and the camera.

    Returns:
        ``e_x_cm``, ``e_y_cm``, ``e_theta_deg`` and ``e_p_px``, the root mean square distance of the features from the
        desired ones; NaN where the LEDs have no image.
    """
    error = docked_error(follower_in_leader, goal_leader_in_follower)
    poses = follower_in_leader.inverse(), goal_leader_in_follower
    try:
        seen, desired = (
            config.camera.pinhole.to_pixels(features_at(config.leds.points, pose, config.camera.mount))
            for pose in poses
        )
        e_p_px = float(np.sqrt(((seen - desired) ** 2).sum(axis=1).mean()))
    except ValueError:
        e_p_px = math.nan
    return {
        "e_x_cm": 100 * abs(error.e_x_m),
        "e_y_cm": 100 * abs(error.e_y_m),
        "e_theta_deg": abs(error.e_theta_deg),
        "e_p_px": e_p_px,
    }
