"""Differential drive: wheel speeds ↔ twist of {F}, wheel angles → the way that {F} went."""

from __future__ import annotations

import math

from common.config import BaseConfig
from common.geometry import Pose2, wrap_angle


def twist_from_wheels(base: BaseConfig, wheel_speed_rad_s: tuple[float, float]) -> tuple[float, float]:
    """(v [m/s], ω [rad/s]) of {F} from the speeds of the (left, right) wheel."""
    left, right = (speed * base.wheel_radius_m for speed in wheel_speed_rad_s)
    return (left + right) / 2, (right - left) / base.track_m


def wheels_from_twist(base: BaseConfig, v_m_s: float, w_rad_s: float) -> tuple[float, float]:
    """Speeds [rad/s] of the (left, right) wheel for a twist of {F}."""
    turn = w_rad_s * base.track_m / 2
    return (v_m_s - turn) / base.wheel_radius_m, (v_m_s + turn) / base.wheel_radius_m


def path_from_wheels(base: BaseConfig, turned_rad: tuple[float, float]) -> tuple[float, float]:
    """(way of {F} along its arc [m], turn [rad]) from the angles that the (left, right) wheel turned."""
    left, right = (angle * base.wheel_radius_m for angle in turned_rad)
    return (left + right) / 2, (right - left) / base.track_m


def arc(distance_m: float, turn_rad: float) -> Pose2:
    """The new {F} in the old one after an arc of this length: the chord points half-way round the turn."""
    half = turn_rad / 2
    chord = distance_m * (math.sin(half) / half if abs(half) > 1e-9 else 1.0)
    return Pose2(chord * math.cos(half), chord * math.sin(half), wrap_angle(turn_rad))
