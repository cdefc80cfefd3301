"""Motion of the observer's seven states ``[x, y, θ, gain, turn_gain, yaw, sideways]`` and its derivative."""

from __future__ import annotations

import cmath

import numpy as np

from common.geometry import Array
from follower.motion import share_of_drift

POSE, DISTURBANCE = slice(0, 3), slice(3, 7)
STATES = 7


def advance(state: Array, v_m_s: float, w_rad_s: float, duration_s: float) -> tuple[Array, Array]:
    """State after driving with a wheel twist, and its derivative by the state, (7, 7).

    The pose of {L} in {F} moves by eq. (relative) with the disturbed twist; the chord of the arc counts for the
    arc, at 60 Hz less than 1e-5 of the way.
    """
    gain, turn_gain, yaw, sideways = state[DISTURBANCE]
    drifting = share_of_drift(v_m_s)
    turn = ((1.0 + turn_gain) * w_rad_s + yaw * drifting) * duration_s
    back, middle = cmath.exp(-1j * turn), cmath.exp(-0.5j * turn)
    driven = middle * complex((1.0 + gain) * v_m_s, sideways * drifting) * duration_s
    seen = back * complex(state[0], state[1])
    moved = seen - driven
    following = state.copy()
    following[0], following[1], following[2] = moved.real, moved.imag, state[2] - turn
    transition = np.eye(STATES)
    transition[0, 0] = transition[1, 1] = back.real
    transition[1, 0], transition[0, 1] = back.imag, -back.imag
    by_turn = -1j * (seen - 0.5 * driven)
    along = -middle * duration_s
    for column, slope, heading in (
        (3, along * v_m_s, 0.0),
        (4, by_turn * w_rad_s * duration_s, -w_rad_s * duration_s),
        (5, by_turn * drifting * duration_s, -drifting * duration_s),
        (6, 1j * along * drifting, 0.0),
    ):
        transition[0, column], transition[1, column], transition[2, column] = slope.real, slope.imag, heading
    return following, transition
