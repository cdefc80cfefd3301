"""How the Follower's motion may differ from what its wheels tell: shared by estimator and controller."""

from __future__ import annotations

from dataclasses import dataclass

FULL_DRIFT_SPEED_M_S = 0.002  # below it a wheel as good as stands


@dataclass(frozen=True)
class MotionDisturbance:
    """Estimated disturbance: the robot moves with v(1 + gain), ω(1 + turn_gain) + yaw, and sideways.

    Attributes:
        gain: relative error of the forward speed,
        turn_gain: of the turn that the wheels make.
        yaw_rad_s: turn besides ω,
        sideways_m_s: drift to the left; both of a robot that moves: nothing carries off one that stands. How they
            fade on the way to standstill is not known; these are their values at the speed of the moment.
    """

    gain: float = 0.0
    turn_gain: float = 0.0
    yaw_rad_s: float = 0.0
    sideways_m_s: float = 0.0


NO_DISTURBANCE = MotionDisturbance()


def share_of_drift(v_m_s: float) -> float:
    """How much of its full drift a robot has at this speed, 0 … 1."""
    return min(1.0, abs(v_m_s) / FULL_DRIFT_SPEED_M_S)


def drifts(disturbance: MotionDisturbance) -> bool:
    """Whether the robot is carried sideways or turned, beyond what noise makes an observer believe."""
    return abs(disturbance.yaw_rad_s) > 0.01 or abs(disturbance.sideways_m_s) > 0.005
