"""Disturbance compensation and saturation of the paper, with the rate limit that they would break re-applied."""

from __future__ import annotations

import numpy as np

from common.config import LimitsConfig
from common.geometry import Array
from follower.controller.interface import SpeedCaps
from follower.controller.limits import reachable_bounds


def compensation(jacobian: Array, disturbance: Array) -> tuple[float, float]:
    """u_C = −J_x⁺ d̂, the least-squares answer to eq. (minsquare).

    Args:
        jacobian: J_x, (2n+1, 2).
        disturbance: d̂, (2n+1,).
    """
    v, w = -np.linalg.lstsq(jacobian, disturbance, rcond=None)[0]
    return float(v), float(w)


def limited(
    wanted: tuple[float, float], last_applied: tuple[float, float], caps: SpeedCaps, limits: LimitsConfig
) -> tuple[float, float]:
    """sat(·) of eq. (getuf), then at most one step of the rate limit away from the last command."""
    v_low, v_high, w_low, w_high = (float(bound[0]) for bound in reachable_bounds(caps, last_applied, limits, 1))
    v, w = min(max(wanted[0], v_low), v_high), min(max(wanted[1], w_low), w_high)
    dv, dw = limits.controller_dv_m_s, limits.controller_dw_rad_s
    return (
        min(max(v, last_applied[0] - dv), last_applied[0] + dv),
        min(max(w, last_applied[1] - dw), last_applied[1] + dw),
    )
