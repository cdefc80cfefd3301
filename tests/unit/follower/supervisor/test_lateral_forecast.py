"""How well the goal is known sideways, by the LEDs that are seen."""

from __future__ import annotations

import math

from common.config import Config
from follower.supervisor.lateral_forecast import settled_sigma_m


def test_three_leds_tell_the_goal_less_well_than_four(config: Config) -> None:
    goal = config.docking.goal(1)
    four = settled_sigma_m(config, goal, ())
    three = [settled_sigma_m(config, goal, (led,)) for led in range(4)]
    assert 0.0 < four < min(three)
    assert settled_sigma_m(config, goal, (0, 1)) == math.inf
