"""Position-based docking as a user would pick it: a filtered pose and the graceful controller of Nav2's docking.

Park and Kuipers 2011 in egocentric polar coordinates, with Nav2's slowdown near the goal. Like there, the dock's pose
is kept in the odometry frame and moved towards each detection by a small share.
"""

from __future__ import annotations

import cmath
import math

from common.geometry import Pose2, wrap_angle

K_PHI, K_DELTA = 2.0, 1.5
BETA, LAMBDA = 0.4, 2.0
SLOWDOWN_M = 0.8
SPEED_MIN_M_S, SPEED_MAX_M_S = 0.03, 0.33
# Tuned on four starts of case T that table1 does not fly, share / arrival / least reach -> mean e_x, e_y, e_theta;
# three of the four end outside the arrival's tolerance.
# The gains above stayed: at share 0.005, arrival 0.03 m and (K_PHI, K_DELTA) = (2, 1.5) (3, 1.5) (3, 2.5) (2, 3)
# e_theta is 1.83 2.08 2.57 2.30 deg.
#   0.030 / 0.01 m / 0.25 m -> 0.77 cm 0.26 cm 8.49 deg      0.003 / 0.03 m / 0.25 m -> 2.32 cm 0.23 cm 0.99 deg
#   0.005 / 0.01 m / 0.25 m -> 0.88 cm 0.18 cm 4.25 deg      0.003 / 0.02 m / 0.25 m -> 1.39 cm 0.22 cm 1.27 deg
#   0.010 / 0.03 m / 0.25 m -> 2.92 cm 0.26 cm 3.06 deg      0.003 / 0.02 m / 0.50 m -> 1.35 cm 0.20 cm 0.86 deg
#   0.005 / 0.03 m / 0.25 m -> 2.86 cm 0.25 cm 1.83 deg      0.002 / 0.02 m / 0.25 m -> 0.31 cm 0.25 cm 1.15 deg
ARRIVED_M = 0.02
REACH_MIN_M = 0.5  # nearer, noise in the bearing would turn the robot on the spot
FILTER_SHARE = 0.003


class FilteredPose:
    """Pose of {L} in {F}, kept still in odometry and corrected by a share of each detection."""

    def __init__(self, first: Pose2) -> None:
        self.pose = first

    def predict(self, moved: Pose2) -> None:
        """The robot moved, by the wheels: pose of the new {F} in the old one."""
        self.pose = moved.inverse().compose(self.pose)

    def correct(self, detected: Pose2) -> None:
        """Take one detection."""
        ours, share = self.pose, FILTER_SHARE
        self.pose = Pose2(
            ours.x_m + share * (detected.x_m - ours.x_m),
            ours.y_m + share * (detected.y_m - ours.y_m),
            wrap_angle(ours.theta_rad + share * wrap_angle(detected.theta_rad - ours.theta_rad)),
        )


def graceful(goal: Pose2, w_max_rad_s: float) -> tuple[float, float]:
    """Velocity (v, ω) towards ``goal``, a pose in {F}; standstill once there or past it."""
    reach = math.hypot(goal.x_m, goal.y_m)
    if reach < ARRIVED_M or goal.x_m <= 0.0:
        return 0.0, 0.0
    delta = -cmath.phase(complex(goal.x_m, goal.y_m))
    phi = wrap_angle(goal.theta_rad + delta)
    turn = K_DELTA * (delta - math.atan(-K_PHI * phi)) + (1 + K_PHI / (1 + (K_PHI * phi) ** 2)) * math.sin(delta)
    curvature = -turn / max(reach, REACH_MIN_M)
    speed = SPEED_MAX_M_S / (1 + BETA * abs(curvature) ** LAMBDA)
    speed = max(SPEED_MIN_M_S, min(speed, SPEED_MAX_M_S * reach / SLOWDOWN_M))
    w = curvature * speed
    if abs(w) > w_max_rad_s:
        speed, w = speed * w_max_rad_s / abs(w), math.copysign(w_max_rad_s, w)
    return speed, w
