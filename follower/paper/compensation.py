"""Disturbance compensation of the paper."""

from __future__ import annotations

import math

import numpy as np

from common.geometry import Array


def compensation(jacobian: Array, disturbance: Array) -> tuple[float, float]:
    """u_C = −J_x⁺ d̂, the least-squares answer to eq. (30): the input that cancels the estimated disturbance best.

    Args:
        jacobian: J_x, (2n+1, 2).
        disturbance: d̂, (2n+1,).

    Returns:
        v [m/s], ω [rad/s]; NaN where the numbers have diverged and nothing cancels them.
    """
    if not (np.isfinite(jacobian).all() and np.isfinite(disturbance).all()):
        return math.nan, math.nan
    v, w = -np.linalg.lstsq(jacobian, disturbance, rcond=None)[0]
    return float(v), float(w)
