"""Prediction model of the paper's 2n+1 states."""

from __future__ import annotations

import casadi as ca
import numpy as np

from common.geometry import Array

MOST_OFF_AXIS = 100.0  # normalised, or rad: a feature or heading beyond is no measurement


def extended_state(features: Array, theta_rad: float) -> Array:
    """``x = [s_0 … s_{n−1}, θ_L^F]``, (2n+1,).

    Args:
        features: (n, 2) normalised.
        theta_rad: θ_L^F.
    """
    return np.append(np.asarray(features, dtype=float).reshape(-1), theta_rad)


def flipped_features(features: Array, height_difference_m: Array) -> bool:
    """Whether noise gave some β the wrong sign, so that its depth Δh/β, eq. (7), would be negative.

    Args:
        features: (n, 2) normalised.
        height_difference_m: (n,) Δh per point.
    """
    return bool(np.any(features[:, 1] * height_difference_m <= 0.0))


def symbolic_euler_step(
    state: ca.SX, control: ca.SX, period_s: float, height_difference_m: Array, camera_xyz_m: Array
) -> ca.SX:
    """One forward-Euler step of the nominal model, eq. (27), with J_s of eq. (10), for CasADi.

    Args:
        state: (2n+1,) features and θ.
        control: v [m/s], ω [rad/s].
        period_s: of the step.
        height_difference_m: (n,) Δh per point, negative for LEDs above the camera.
        camera_xyz_m: ξ in {F}.
    """
    v, w = control[0], control[1]
    t_x, t_y = float(camera_xyz_m[0]), float(camera_xyz_m[1])
    rates = []
    for i, height in enumerate(height_difference_m):
        alpha, beta = state[2 * i], state[2 * i + 1]
        inverse_depth = beta / float(height)
        rates.append(alpha * inverse_depth * v + (1 + alpha**2 + inverse_depth * (t_x - alpha * t_y)) * w)
        rates.append(beta * inverse_depth * v + (alpha * beta - beta * inverse_depth * t_y) * w)
    rates.append(-w)
    return state + period_s * ca.vertcat(*rates)
