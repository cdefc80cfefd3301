"""Position-based docking as a user would pick it: the graceful controller of Nav2's docking, on a filtered pose.

Park and Kuipers 2011 in egocentric polar coordinates, with Nav2's slowdown near the goal.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

from common.geometry import Pose2, wrap_angle

LAMBDA = 2.0
SPEED_MIN_M_S, SPEED_MAX_M_S = 0.03, 0.33


@dataclass(frozen=True, kw_only=True)
class GracefulGains:
    """What Nav2's controller leaves to its user.

    Attributes:
        k_phi, k_delta: how much heading at the goal counts against bearing, and how fast the curve is taken.
        beta: how much curvature slows.
        slowdown_m: distance below which speed falls with it.
        reach_min_m: nearer, noise in the bearing would turn the robot on the spot.
        arrived_m: distance at which it stands.
    """

    k_phi: float
    k_delta: float
    beta: float
    slowdown_m: float
    reach_min_m: float
    arrived_m: float


def graceful(goal: Pose2, w_max_rad_s: float, gains: GracefulGains) -> tuple[float, float]:
    """Velocity (v, ω) towards ``goal``, a pose in {F}; standstill once there or past it."""
    reach = math.hypot(goal.x_m, goal.y_m)
    if reach < gains.arrived_m or goal.x_m <= 0.0:
        return 0.0, 0.0
    delta = -cmath.phase(complex(goal.x_m, goal.y_m))
    phi = wrap_angle(goal.theta_rad + delta)
    turn = gains.k_delta * (delta - math.atan(-gains.k_phi * phi)) + (
        1 + gains.k_phi / (1 + (gains.k_phi * phi) ** 2)
    ) * math.sin(delta)
    curvature = -turn / max(reach, gains.reach_min_m)
    speed = SPEED_MAX_M_S / (1 + gains.beta * abs(curvature) ** LAMBDA)
    speed = max(SPEED_MIN_M_S, min(speed, SPEED_MAX_M_S * reach / gains.slowdown_m))
    w = curvature * speed
    if abs(w) > w_max_rad_s:
        speed, w = speed * w_max_rad_s / abs(w), math.copysign(w_max_rad_s, w)
    return speed, w
