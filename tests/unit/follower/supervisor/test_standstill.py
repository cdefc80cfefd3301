"""Standing: for how long, and by what is measured."""

from __future__ import annotations

from dataclasses import replace

import pytest

from common.config import Config
from common.timing import NS_PER_S
from follower.supervisor.standstill import Standstill
from tests.rigs.supervisor_rig import DRIVES


@pytest.mark.parametrize("hundredths_s", [18, 19, 20, 21, 500])
def test_it_stands_once_it_has_stood_for_a_fifth_of_a_second(config: Config, hundredths_s: int) -> None:
    standstill = Standstill(config.base)
    for n in range(hundredths_s + 1):
        now_ns = n * NS_PER_S // 100
        standstill.step(now_ns, replace(DRIVES, measured_ns=now_ns, wheel_angle_rad=(3.0, 3.0 + n * 1e-5)))
    assert standstill.holds == (hundredths_s >= 20)


def test_it_stands_over_a_step_that_is_not_heard_not_over_a_measurement_that_stays(config: Config) -> None:
    standstill = Standstill(config.base)
    for n in range(0, 300, 50):
        heard = replace(DRIVES, measured_ns=n * NS_PER_S // 1000, wheel_angle_rad=(3.0, 3.0))
        standstill.step(n * NS_PER_S // 1000, heard if n % 100 == 50 else None)
    assert standstill.holds
    standstill.step(350 * NS_PER_S // 1000, heard)
    assert standstill.holds
    standstill.step(351 * NS_PER_S // 1000, heard)
    assert not standstill.holds
    for n, turned_rad in ((355, 0.0), (360, 0.1), (365, 0.0)):
        now_ns = n * NS_PER_S // 1000
        standstill.step(now_ns, replace(DRIVES, measured_ns=now_ns, wheel_angle_rad=(3.0 + turned_rad, 3.0)))
    assert not standstill.holds
