"""Motion of the observer's seven states ``[x, y, θ, gain, turn_gain, yaw, sideways]`` and its derivative."""

from __future__ import annotations

import numpy as np

from common.geometry import Array
from follower.model.motion import share_of_drift

POSE, DISTURBANCE = slice(0, 3), slice(3, 7)
STATES = 7


def advance(state: Array, v_m_s: float, w_rad_s: float, duration_s: float) -> tuple[Array, Array]:
    """State (7,) after driving with a wheel twist, and its derivative by the state, (7, 7)."""
    following, slopes = advance_all(state[None], v_m_s, w_rad_s, duration_s)
    transition = np.eye(STATES)
    transition[POSE] = slopes[0]
    return following[0], transition


def advance_all(states: Array, v_m_s: float, w_rad_s: float, duration_s: float) -> tuple[Array, Array]:
    """States (k, 7) after driving with one wheel twist, and the derivative of each pose by its state, (k, 3, 7).

    The pose of {L} in {F} moves by eq. (relative) with the disturbed twist; the chord of the arc counts for the
    arc, at 60 Hz less than 1e-5 of the way. The disturbances stay what they are.
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
