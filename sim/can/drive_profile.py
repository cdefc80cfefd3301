"""Profiles inside a simulated drive: how its set-points move to the master's targets."""

from __future__ import annotations

import math


def ramp(value: float, target: float, acceleration: float, deceleration: float, elapsed_s: float) -> float:
    """``value`` moved towards ``target``; through a change of sign it slows down to zero first.

    Args:
        value, target: set-point and its target, in any unit.
        acceleration: rate away from zero, per second.
        deceleration: rate towards zero, per second.
        elapsed_s: time since the last step.
    """
    remaining_s = elapsed_s
    if value * target < 0.0:
        stop_s = abs(value) / deceleration
        if remaining_s < stop_s:
            return value - math.copysign(deceleration * remaining_s, value)
        value, remaining_s = 0.0, remaining_s - stop_s
    rate = acceleration if abs(target) > abs(value) else deceleration
    step = rate * remaining_s
    return target if abs(target - value) <= step else value + math.copysign(step, target - value)


def approach(
    position: float, speed: float, target: float, limit: float, acceleration: float, elapsed_s: float
) -> tuple[float, float]:
    """Position and speed of a trapezoidal profile after one step; it arrives without overshoot.

    Args:
        position, speed: now; in the drive's unit, and per second.
        target: where the profile ends.
        limit: largest speed.
        acceleration: of the profile, also for braking.
        elapsed_s: time since the last step.
    """
    distance = target - position
    allowed = min(limit, math.sqrt(2.0 * acceleration * abs(distance)))
    speed = ramp(speed, math.copysign(allowed, distance), acceleration, acceleration, elapsed_s)
    step = speed * elapsed_s
    if abs(step) >= abs(distance) and speed * distance >= 0.0:
        return target, 0.0
    return position + step, speed
