"""How the Follower moves: the twist of its wheels, disturbed; shared by estimator, supervisor and controller.

How a drift fades on the way to standstill is not known: rubber yields, wheels scrub. Three rules follow, one
for each use (docs/decisions/0011-control-observer-and-solver.md):

* the observer estimates the drift at the present speed; a robot that stands has none (:func:`share_of_drift`);
* what it has learned becomes doubtful as the speed falls (:class:`FadeDoubt`);
* a plan expects the sideways drift to stay the same for each metre driven (:func:`planned_share`), the yaw to stay.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from common.geometry import Array

FULL_DRIFT_SPEED_M_S = 0.002  # below it a wheel counts as standing
FADING_BELOW_M_S = 0.05  # in a plan
FADE_DOUBT = 0.7  # how far, of itself, a drift may be from the assumed fading when the speed has fallen to 1/e
DOUBTED_BELOW_M_S = 0.08
STANDING_M_S = 1e-3

POSE, DISTURBANCE = slice(0, 3), slice(3, 7)
STATES = 7


@dataclass(frozen=True)
class MotionDisturbance:
    """Estimated disturbance: the robot moves with v(1 + gain), ω(1 + turn_gain) + yaw, and sideways.

    Attributes:
        gain: relative error of the forward speed,
        turn_gain: of the turn that the wheels make.
        yaw_rad_s: turn besides ω,
        sideways_m_s: drift to the left; both of a robot that moves, at the speed of the moment.
    """

    gain: float = 0.0
    turn_gain: float = 0.0
    yaw_rad_s: float = 0.0
    sideways_m_s: float = 0.0


NO_DISTURBANCE = MotionDisturbance()


def drifts(disturbance: MotionDisturbance) -> bool:
    """Whether the robot is carried sideways or turned, beyond what noise alone makes an observer estimate."""
    return abs(disturbance.yaw_rad_s) > 0.01 or abs(disturbance.sideways_m_s) > 0.005


def share_of_drift(v_m_s: float) -> float:
    """How much of its drift a robot has at this speed, 0 … 1: nothing carries off one that stands."""
    return min(1.0, abs(v_m_s) / FULL_DRIFT_SPEED_M_S)


def planned_share(v_m_s: Array) -> Array:
    """(N,) share of the full sideways drift that a plan expects: in proportion to the speed when slow.

    Args:
        v_m_s: (N,) speeds.
    """
    share: Array = np.minimum(1.0, np.abs(v_m_s) / FADING_BELOW_M_S)
    return share


class FadeDoubt:
    """How doubtful a drift has become since it was learned at a higher speed."""

    def __init__(self) -> None:
        self._least_m_s = STANDING_M_S

    def variance(self, v_m_s: float) -> float:
        """Variance (relative to the squared drift) added when the speed falls below its recent minimum."""
        speed = max(abs(v_m_s), STANDING_M_S)
        if speed >= DOUBTED_BELOW_M_S:
            self._least_m_s = DOUBTED_BELOW_M_S
        slower = max(0.0, math.log(self._least_m_s / speed))
        self._least_m_s = min(self._least_m_s, speed)
        return FADE_DOUBT**2 * slower


def advance(state: Array, v_m_s: float, w_rad_s: float, duration_s: float) -> tuple[Array, Array]:
    """One state driven on; see :func:`advance_all`.

    Args:
        state: (7,) ``[x, y, θ, gain, turn_gain, yaw, sideways]``: the pose of {L} in {F} and the disturbance.
        v_m_s: speed by the wheels.
        w_rad_s: turn rate by the wheels.
        duration_s: for how long.

    Returns:
        The state (7,) afterwards, and its derivative by the state before, (7, 7).
    """
    following, slopes = advance_all(state[None], v_m_s, w_rad_s, duration_s)
    transition = np.eye(STATES)
    transition[POSE] = slopes[0]
    return following[0], transition


def advance_all(states: Array, v_m_s: float, w_rad_s: float, duration_s: float) -> tuple[Array, Array]:
    """States driven on with one wheel twist: eq. (2), the motion of {L} in {F}, with the disturbed twist.

    The chord of the arc counts for the arc, at 60 Hz less than 1e-5 of the distance. The disturbances stay what they
    are.

    Args:
        states: (k, 7) ``[x, y, θ, gain, turn_gain, yaw, sideways]`` each.
        v_m_s: speed by the wheels.
        w_rad_s: turn rate by the wheels.
        duration_s: for how long.

    Returns:
        The states (k, 7) afterwards, and the derivative of each pose by its state before, (k, 3, 7).
    """
    drifting = share_of_drift(v_m_s)
    gain, turn_gain, yaw, sideways = states[:, DISTURBANCE].T
    turn = turn_gain * (w_rad_s * duration_s) + yaw * (drifting * duration_s) + w_rad_s * duration_s
    middle = np.exp(-0.5j * turn)
    back = middle * middle
    along = middle * -duration_s
    moved = along * (gain * v_m_s + sideways * (1j * drifting) + v_m_s)
    seen = back * (states[:, 0] + 1j * states[:, 1])
    by_turn = (seen + 0.5 * moved) * -1j
    seen += moved
    following = states.copy()
    following[:, 0], following[:, 1] = seen.real, seen.imag
    following[:, 2] -= turn
    plane = np.zeros((STATES, len(states)), dtype=complex)  # x + iy by each state
    plane[0], plane[1] = back, 1j * back
    plane[3] = along * v_m_s
    plane[4], plane[5] = by_turn * (w_rad_s * duration_s), by_turn * (drifting * duration_s)
    plane[6] = along * (1j * drifting)
    slopes = np.empty((len(states), 3, STATES))
    slopes[:, 0], slopes[:, 1] = plane.real.T, plane.imag.T
    slopes[:, 2] = (0.0, 0.0, 1.0, 0.0, -w_rad_s * duration_s, -drifting * duration_s, 0.0)
    return following, slopes
