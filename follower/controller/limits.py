"""Bounds of velocity, rate and view, as every controller applies them."""

from __future__ import annotations

from dataclasses import astuple

import numpy as np

from common.config import LimitsConfig
from common.geometry import Array, Pinhole
from follower.controller.interface import SpeedCaps, Velocity

_MOST_TIMES_LIMIT = 10.0  # a last command so far beyond the limits is no command of this robot


def possible_request(caps: SpeedCaps, last_applied: Velocity, limits: LimitsConfig) -> bool:
    """Whether bounds can be made of these: all finite, no cap inverted, and a last command the robot could drive."""
    if len(last_applied) != 2 or not np.isfinite([*last_applied, *astuple(caps)]).all():
        return False
    fastest = max(abs(limits.v_min_m_s), limits.v_max_m_s), limits.w_max_rad_s
    drivable = all(abs(u) <= _MOST_TIMES_LIMIT * most for u, most in zip(last_applied, fastest, strict=True))
    v_low, v_high = max(caps.v_min_m_s, limits.v_min_m_s), min(caps.v_max_m_s, limits.v_max_m_s)
    return drivable and v_low <= v_high and caps.w_max_rad_s >= 0.0


def reachable_bounds(
    caps: SpeedCaps, last_applied: Velocity, limits: LimitsConfig, horizon: int
) -> tuple[Array, Array, Array, Array]:
    """Bounds of v and ω for each stage, (N_p,) each: v_min, v_max, ω_min, ω_max.

    A cap below the speed driven now is approached as fast as the rate limit allows, so that caps and rate limit
    never contradict each other.

    Args:
        caps: velocity bounds now.
        last_applied: the command published last.
        limits: the configured bounds, with the rate limit.
        horizon: N_p.
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


def limited(wanted: Velocity, last_applied: Velocity, caps: SpeedCaps, limits: LimitsConfig) -> Velocity:
    """sat(·) of eq. (31), the velocity bounds, then at most one step of the rate limit away from the last command.

    Args:
        wanted: v [m/s], ω [rad/s].
        last_applied: the command published last.
        caps: velocity bounds now.
        limits: the configured ones, with the rate limit.
    """
    v_low, v_high, w_low, w_high = (float(bound[0]) for bound in reachable_bounds(caps, last_applied, limits, 1))
    v, w = min(max(wanted[0], v_low), v_high), min(max(wanted[1], w_low), w_high)
    dv, dw = limits.controller_dv_m_s, limits.controller_dw_rad_s
    return (
        min(max(v, last_applied[0] - dv), last_applied[0] + dv),
        min(max(w, last_applied[1] - dw), last_applied[1] + dw),
    )


def visibility_bounds(pinhole: Pinhole, margin_px: float, points: int) -> tuple[Array, Array]:
    """s_min, s_max of eq. (28), the features' bounds: (2n,) each, the image less a margin."""
    corners = np.array([[margin_px, margin_px], [pinhole.width_px - 1, pinhole.height_px - 1]])
    corners[1] -= margin_px
    low, high = pinhole.to_normalised(corners)
    return np.tile(low, points), np.tile(high, points)
