"""Spots as bright as LEDs at the fitted pose, and clutter that is not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.config import Config
from common.geometry import Array, Pose2
from follower.estimator.identity.brightness import LedBrightness
from follower.estimator.spots import SpotRule, find_spots
from sim.optics.image import Optics, View

THRESHOLD = 25


@pytest.fixture(scope="module")
def optics(config: Config) -> Optics:
    return Optics(config.camera, config.leds, seed=2)


def masses(config: Config, optics: Optics, distance_m: float, current_a: float = 1.0) -> Array:
    image = np.zeros((config.camera.height_px, config.camera.width_px), np.uint8)
    optics.render(image, View(3, Pose2(distance_m, 0.3, 0.1), (current_a,) * 4))
    return find_spots(image, SpotRule(THRESHOLD, 2, 6000)).mass


def state(distance_m: float) -> Array:
    return np.array([distance_m, 0.3, 0.1, 0.0, 0.0])


@pytest.mark.parametrize("distance_m", [1.5, 3.0, 6.0, 9.5])
def test_leds_are_as_bright_as_leds(config: Config, optics: Optics, distance_m: float) -> None:
    brightness = LedBrightness(config.leds, config.camera)
    seen = masses(config, optics, distance_m)
    ratio = brightness.measured(seen, THRESHOLD) / np.median(brightness.expected(state(distance_m)))
    assert len(seen) == 4
    assert 0.5 < np.median(ratio) < 2.0
    assert brightness.judge(state(distance_m), seen, THRESHOLD) == "like"
    assert brightness.judge(state(distance_m), masses(config, optics, distance_m, 4.0), THRESHOLD) == "like"


def test_dim_points_near_by_and_glaring_ones_far_off_are_no_leds(config: Config, optics: Optics) -> None:
    brightness = LedBrightness(config.leds, config.camera)
    dim = masses(config, optics, 9.5)
    assert brightness.judge(state(1.5), dim, THRESHOLD) == "dim"
    assert brightness.judge(state(1.5), dim, THRESHOLD, light=0.05) == "like", "under a shorter exposure"
    assert brightness.judge(state(9.5), masses(config, optics, 1.5), THRESHOLD) == "unlike"


def test_one_of_another_brightness_is_no_led_and_an_unseen_one_is_no_matter(config: Config, optics: Optics) -> None:
    brightness = LedBrightness(config.leds, config.camera)
    seen = masses(config, optics, 1.5)
    seen[1] = masses(config, optics, 9.5)[1]
    assert brightness.judge(state(1.5), seen, THRESHOLD) != "like"
    seen[1] = np.nan
    assert brightness.judge(state(1.5), seen, THRESHOLD) == "like"


@given(a=st.floats(200.0, 1e5), b=st.floats(200.0, 1e5))
def test_more_mass_is_more_strength(config: Config, a: float, b: float) -> None:
    low, high = LedBrightness(config.leds, config.camera).measured(np.array(sorted((a, b))), THRESHOLD)
    assert low <= high


def test_it_is_not_made_up_where_it_was_not_measured(config: Config) -> None:
    dark = config.leds.model_copy(update={"brightness": None})
    with pytest.raises(ValueError, match=r"leds\.brightness is not configured"):
        LedBrightness(dark, config.camera)
