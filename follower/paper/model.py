"""Prediction model of the paper's 2n+1 states, symbolic for the NLP and numeric for everything else."""

from __future__ import annotations

import casadi as ca
import numpy as np

from common.geometry import Array, extended_interaction_matrix


def extended_state(features: Array, theta_rad: float) -> Array:
    """``x = [s_0 … s_{n−1}, θ_L^F]``, (2n+1,)."""
    return np.append(np.asarray(features, dtype=float).reshape(-1), theta_rad)


def euler_step(
    state: Array, v_m_s: float, w_rad_s: float, period_s: float, height_difference_m: Array, camera_xyz_m: Array
) -> Array:
    """One forward-Euler step of the nominal model: eq. (dis_dynamics).

    Args:
        state: (2n+1,) features and θ.
        height_difference_m: (n,) Δh per point, negative for LEDs above the camera.
        camera_xyz_m: ξ in {F}.
    """
    jacobian = extended_interaction_matrix(state[:-1].reshape(-1, 2), height_difference_m, camera_xyz_m)
    advanced: Array = state + period_s * jacobian @ [v_m_s, w_rad_s]
    return advanced


def flipped_features(features: Array, height_difference_m: Array) -> bool:
    """Whether noise gave some β the wrong sign, so that its depth Δh/β would be negative: eq. (depthscale)."""
    return bool(np.any(features[:, 1] * height_difference_m <= 0.0))


def symbolic_euler_step(
    state: ca.SX, control: ca.SX, period_s: float, height_difference_m: Array, camera_xyz_m: Array
) -> ca.SX:
    """The same step for CasADi: ``state`` (2n+1,), ``control`` [v, ω]: eqs. (interaction_matrix), (dis_dynamics)."""
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
