"""Differential drive: wheel speeds ↔ twist of {F}, wheel angles → the path of {F}."""

from __future__ import annotations

from common.config import BaseConfig


def twist_from_wheels(base: BaseConfig, wheel_speed_rad_s: tuple[float, float]) -> tuple[float, float]:
    """(v [m/s], ω [rad/s]) of {F} from the speeds of the (left, right) wheel."""
    left, right = (speed * base.wheel_radius_m for speed in wheel_speed_rad_s)
    return (left + right) / 2, (right - left) / base.track_m


def wheels_from_twist(base: BaseConfig, v_m_s: float, w_rad_s: float) -> tuple[float, float]:
    """Speeds [rad/s] of the (left, right) wheel for a twist of {F}."""
    turn = w_rad_s * base.track_m / 2
    return (v_m_s - turn) / base.wheel_radius_m, (v_m_s + turn) / base.wheel_radius_m


def path_from_wheels(base: BaseConfig, turned_rad: tuple[float, float]) -> tuple[float, float]:
    """(distance of {F} along its arc [m], turn [rad]) from the angles that the (left, right) wheel turned."""
    left, right = (angle * base.wheel_radius_m for angle in turned_rad)
    return (left + right) / 2, (right - left) / base.track_m
