"""Settings of the sweep."""

from __future__ import annotations

from common.config import default_config_path, load_config
from experiments.feature_level.scenes import random_pads
from experiments.feature_level.sweep_settings import with_horizon, with_points

CONFIG = load_config(default_config_path())


def test_settings_change_what_they_say() -> None:
    assert with_horizon(CONFIG, 20).controller.realtime.knots[-1] == 19
    assert with_points(CONFIG, 6).leds.points.shape == (6, 3)
    assert random_pads(1) == random_pads(1) != random_pads(2)
