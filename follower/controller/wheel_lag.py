"""Wheels follow their command with a lag: the linear map from commands to what the wheels do."""

from __future__ import annotations

import math

import numpy as np

from common.geometry import Array


def wheel_response(steps: int, period_s: float, lag_s: float) -> tuple[Array, Array]:
    """Mean wheel speed of each step: (N, N) from the commands and (N,) from the speed at the start.

    A first-order lag, exactly discretised; commands are held for a period.
    """
    if lag_s == 0:
        return np.eye(steps), np.zeros(steps)
    keep = math.exp(-period_s / lag_s)
    share = (1.0 - keep) * lag_s / period_s  # of the speed at a step's start in that step's mean
    response, free = np.zeros((steps, steps)), np.zeros(steps)
    row, left = np.zeros(steps), 1.0
    for k in range(steps):
        response[k] = share * row
        response[k, k] += 1.0 - share
        free[k] = share * left
        row, left = keep * row, keep * left
        row[k] += 1.0 - keep
    return response, free
