"""Where a sequence of inputs brings the Follower, and how that changes with each of them, in closed form.

The exact discretisation of eq. (2), the relative motion, but for the chord of each step's arc, which counts for the
arc: at 0.6 rad/s and 50 ms that is 4e-5 of the step. Disturbances scale with speed (see ``MotionDisturbance``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.geometry import Array, Pose2
from follower.model.motion import FADING_BELOW_M_S, MotionDisturbance, planned_share

ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True)
class Rollout:
    """Motion over N steps in the {F} of the first one.

    Attributes:
        heading_rad: (N + 1,) turned since the start.
        position_m: (N + 1,) complex, x + iy.
        step_m: (N,) complex, chord of each step for v = 1 m/s.
    """

    start: Pose2
    heading_rad: Array
    position_m: ComplexArray
    step_m: ComplexArray
    turn_by_w: float
    period_s: float

    def pose(self, k: int) -> Pose2:
        """Pose of {L} in {F} after k steps."""
        to_leader = complex(self.start.x_m, self.start.y_m) - complex(self.position_m[k])
        seen = to_leader * self._turned_back(k)
        return Pose2(seen.real, seen.imag, self.start.theta_rad - float(self.heading_rad[k]))

    def poses(self) -> Array:
        """All poses, (N + 1, 3)."""
        seen = self._seen(self.position_m) * np.exp(-1j * self.heading_rad)
        return np.stack([seen.real, seen.imag, self.start.theta_rad - self.heading_rad], axis=1)

    def sensitivity(self, k: int) -> tuple[Array, Array]:
        """Derivatives of ``pose(k)`` by v_j and by ω_j, (3, k) each, j < k."""
        back = self._turned_back(k)
        middle = 0.5 * (self.position_m[:k] + self.position_m[1 : k + 1])
        by_turn = -1j * self.period_s * back * self._seen(middle)
        by_v = -back * self.step_m[:k]
        turned = np.full(k, -self.period_s)
        return (
            np.stack([by_v.real, by_v.imag, np.zeros(k)]),
            self.turn_by_w * np.stack([by_turn.real, by_turn.imag, turned]),
        )

    def _turned_back(self, k: int) -> complex:
        angle = -float(self.heading_rad[k])
        return complex(math.cos(angle), math.sin(angle))

    def _seen(self, position_m: ComplexArray) -> ComplexArray:
        """Vector to the origin of {L}, axes of the first {F}."""
        seen: ComplexArray = complex(self.start.x_m, self.start.y_m) - position_m
        return seen


def roll_out(start: Pose2, v_m_s: Array, w_rad_s: Array, period_s: float, disturbance: MotionDisturbance) -> Rollout:
    """Motion with inputs held for one period each.

    The yaw stays: a plan need not predict how it fades, since every later plan corrects for what it then is. The
    sideways drift, which nothing corrects for, fades in proportion to the speed below ``FADING_BELOW_M_S``.

    Args:
        start: pose of {L} in {F}.
        v_m_s: (N,) inputs v.
        w_rad_s: (N,) inputs ω.
        period_s: of one input.
        disturbance: of a robot that moves at full speed.
    """
    moving = planned_share(v_m_s)
    turn = ((1.0 + disturbance.turn_gain) * w_rad_s + disturbance.yaw_rad_s) * period_s
    heading = np.empty(turn.size + 1)
    heading[0] = 0.0
    np.cumsum(turn, out=heading[1:])
    direction = np.exp(1j * (heading[:-1] + 0.5 * turn))
    position = np.empty(turn.size + 1, dtype=complex)
    position[0] = 0.0
    local = (1.0 + disturbance.gain) * v_m_s + 1j * disturbance.sideways_m_s * moving
    np.cumsum(direction * local * period_s, out=position[1:])
    fading = np.where(moving < 1.0, np.sign(v_m_s) / FADING_BELOW_M_S, 0.0)
    by_v = direction * (1.0 + disturbance.gain + 1j * disturbance.sideways_m_s * fading) * period_s
    return Rollout(start, heading, position, by_v, 1.0 + disturbance.turn_gain, period_s)
