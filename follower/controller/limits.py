"""Velocity bounds and the rate limit, as every controller here applies them."""

from __future__ import annotations

from dataclasses import astuple

import numpy as np

from common.config import LimitsConfig
from common.geometry import Array
from follower.controller.interface import SpeedCaps

_MOST_TIMES_LIMIT = 10.0  # a last command so far beyond the limits is no command of this robot


def possible_request(caps: SpeedCaps, last_applied: tuple[float, float], limits: LimitsConfig) -> bool:
    """Whether bounds can be made of these: all finite, no cap inverted, and a last command the robot could drive."""
    if len(last_applied) != 2 or not np.isfinite([*last_applied, *astuple(caps)]).all():
        return False
    fastest = max(abs(limits.v_min_m_s), limits.v_max_m_s), limits.w_max_rad_s
    drivable = all(abs(u) <= _MOST_TIMES_LIMIT * most for u, most in zip(last_applied, fastest, strict=True))
    v_low, v_high = max(caps.v_min_m_s, limits.v_min_m_s), min(caps.v_max_m_s, limits.v_max_m_s)
    return drivable and v_low <= v_high and caps.w_max_rad_s >= 0.0


def reachable_bounds(
    caps: SpeedCaps, last_applied: tuple[float, float], limits: LimitsConfig, horizon: int
) -> tuple[Array, Array, Array, Array]:
    """Bounds of v and ω for each stage, (N_p,) each: v_min, v_max, ω_min, ω_max.

    A cap below the speed driven now is approached as fast as the rate limit allows, so that caps and rate limit
    never contradict each other.
    """
    steps = np.arange(1, horizon + 1)
    v, w = last_applied
    dv, dw = limits.controller_dv_m_s * steps, limits.controller_dw_rad_s * steps
    v_low, v_high = max(caps.v_min_m_s, limits.v_min_m_s), min(caps.v_max_m_s, limits.v_max_m_s)
    w_cap = min(caps.w_max_rad_s, limits.w_max_rad_s)
    return (
        np.minimum(v_low, v + dv),
        np.maximum(v_high, v - dv),
        np.minimum(-w_cap, w + dw),
        np.maximum(w_cap, w - dw),
    )
