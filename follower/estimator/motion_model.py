"""Motion of the observer's seven states ``[x, y, θ, gain, turn_gain, yaw, sideways]`` and its derivative."""

from __future__ import annotations

import numpy as np

from common.geometry import Array
from follower.motion import share_of_drift

POSE, DISTURBANCE = slice(0, 3), slice(3, 7)
STATES = 7


def advance(state: Array, v_m_s: float, w_rad_s: float, duration_s: float) -> tuple[Array, Array]:
    """State (7,) after driving with a wheel twist, and its derivative by the state, (7, 7)."""
    following, transition = advance_all(state[None], v_m_s, w_rad_s, duration_s)
    return following[0], transition[0]


def advance_all(states: Array, v_m_s: float, w_rad_s: float, duration_s: float) -> tuple[Array, Array]:
    """States (k, 7) after driving with one wheel twist, and the derivative of each by itself, (k, 7, 7).

    The pose of {L} in {F} moves by eq. (relative) with the disturbed twist; the chord of the arc counts for the
    arc, at 60 Hz less than 1e-5 of the way.
    """
    drifting = share_of_drift(v_m_s)
    gain, turn_gain, yaw, sideways = states[:, DISTURBANCE].T
    turn = ((1.0 + turn_gain) * w_rad_s + yaw * drifting) * duration_s
    middle = np.exp(-0.5j * turn)
    back = middle * middle
    driven = middle * ((1.0 + gain) * v_m_s + 1j * sideways * drifting) * duration_s
    seen = back * (states[:, 0] + 1j * states[:, 1])
    moved = seen - driven
    following = states.copy()
    following[:, 0], following[:, 1] = moved.real, moved.imag
    following[:, 2] -= turn
    slopes = np.empty((len(states), 4), dtype=complex)
    along = -middle * duration_s
    by_turn = -1j * (seen - 0.5 * driven)
    slopes[:, 0] = along * v_m_s
    slopes[:, 1] = by_turn * (w_rad_s * duration_s)
    slopes[:, 2] = by_turn * (drifting * duration_s)
    slopes[:, 3] = 1j * along * drifting
    transition = np.zeros((len(states), STATES, STATES))
    transition.reshape(len(states), -1)[:, :: STATES + 1] = 1.0
    transition[:, 0, 0] = transition[:, 1, 1] = back.real
    transition[:, 1, 0], transition[:, 0, 1] = back.imag, -back.imag
    transition[:, 0, DISTURBANCE], transition[:, 1, DISTURBANCE] = slopes.real, slopes.imag
    transition[:, 2, 4], transition[:, 2, 5] = -w_rad_s * duration_s, -drifting * duration_s
    return following, transition
