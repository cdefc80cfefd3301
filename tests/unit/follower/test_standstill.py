"""Standstill at its edges: driving, turning on the spot, noise, missing measurements."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from common.config import Config
from common.kinematics import wheels_from_twist
from common.timing import NS_PER_MS
from follower.standstill import Standstill


@dataclass(frozen=True)
class Wheels:
    """A measurement of both wheels."""

    measured_ns: int
    wheel_angle_rad: tuple[float, float] = (3.0, 3.0)


def stands_after_s(config: Config, seconds: float, v_m_s: float = 0.0, w_rad_s: float = 0.0) -> bool:
    """Whether it stands after moving steadily for so long, measured every 10 ms."""
    standstill = Standstill(config.base)
    left, right = wheels_from_twist(config.base, v_m_s, w_rad_s)
    for n in range(round(seconds * 100) + 1):
        now_ns = n * 10 * NS_PER_MS
        standstill.step(now_ns, Wheels(now_ns, (3.0 + left * n / 100, 3.0 + right * n / 100)))
    return standstill.holds


@pytest.mark.parametrize(("seconds", "stands"), [(0.0, False), (0.19, False), (0.2, True), (0.21, True), (5.0, True)])
def test_it_stands_once_it_has_stood_for_a_fifth_of_a_second(config: Config, seconds: float, stands: bool) -> None:
    assert stands_after_s(config, seconds) == stands


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("v_m_s", "w_rad_s", "stands"),
    [(0.0049, 0.0, True), (0.0051, 0.0, False), (0.0, 0.0199, True), (0.0, 0.0201, False), (0.0, 0.3, False)],
)
def test_neither_driving_nor_turning_on_the_spot_is_standstill(
    config: Config, v_m_s: float, w_rad_s: float, sign: float, stands: bool
) -> None:
    assert stands_after_s(config, 1.0, sign * v_m_s, sign * w_rad_s) == stands


def test_to_and_fro_within_the_window_is_no_standstill(config: Config) -> None:
    standstill = Standstill(config.base)
    for n, turned_rad in enumerate((0.0, 0.0, 0.1, 0.0, 0.0)):
        now_ns = n * 50 * NS_PER_MS
        standstill.step(now_ns, Wheels(now_ns, (3.0 + turned_rad, 3.0)))
    assert not standstill.holds


def test_a_missing_step_is_no_motion_and_an_old_measurement_is_no_standstill(config: Config) -> None:
    standstill = Standstill(config.base)
    for n in range(0, 300, 50):
        wheels = Wheels(n * NS_PER_MS)
        standstill.step(n * NS_PER_MS, wheels if n % 100 == 50 else None)
    assert standstill.holds
    standstill.step(350 * NS_PER_MS, wheels)
    assert standstill.holds
    standstill.step(351 * NS_PER_MS, wheels)
    assert not standstill.holds


def test_before_the_first_measurement_it_does_not_stand(config: Config) -> None:
    standstill = Standstill(config.base)
    assert not standstill.holds
    for n in range(10):
        standstill.step(n * 10 * NS_PER_MS, Wheels(-1))
    standstill.step(200 * NS_PER_MS, Wheels(200 * NS_PER_MS))
    assert not standstill.holds
