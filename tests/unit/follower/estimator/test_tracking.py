"""Prediction of features and assignment of spots to them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from common.config import Config
from common.frames.ring import Image
from common.geometry import Array, Pose2, features_at, move_relative
from follower.estimator.lens import Lens
from follower.estimator.planar_fit import FitModel
from follower.estimator.spots import SpotRule
from follower.estimator.tracking import ArrayTracker, Followed, moved_together, nearest_within, predict_features


def test_prediction_follows_the_motion(config: Config) -> None:
    before = Pose2(4.0, 0.5, 0.2)
    after = move_relative(before, 0.4, -0.3, 1 / 60)
    height = config.camera.mount[2] - config.leds.points[:, 2]
    features = features_at(config.leds.points, before, config.camera.mount)
    predicted = predict_features(features, height, config.camera.mount, (0.4, -0.3), 1 / 60)
    truth = features_at(config.leds.points, after, config.camera.mount)
    assert predicted == pytest.approx(truth, abs=5e-5)
    assert np.abs(features - truth).max() > 10 * np.abs(predicted - truth).max()


def test_each_spot_is_taken_once_and_only_within_the_gate() -> None:
    predicted = np.array([[10.0, 10.0], [14.0, 10.0], [100.0, 10.0]])
    spots = np.array([[13.0, 10.0], [11.0, 10.0], [120.0, 10.0]])
    assert nearest_within(predicted, spots, 12.0) == [1, 0, -1]


def test_no_spots() -> None:
    assert nearest_within(np.zeros((2, 2)), np.zeros((0, 2)), 5.0) == [-1, -1]


HERE = np.array([4.0, 0.1, 0.05, 0.0, 0.0])
RULE = SpotRule(25, 2, 6000)


class Sky:
    """Round spots where one wants them, and the tracker that looks at them."""

    def __init__(self, config: Config) -> None:
        model = FitModel(config.leds.points, config.camera.mount, 0.3 / config.camera.lens.fx_px, math.radians(0.7))
        lens = Lens(config.camera)
        self.tracker = ArrayTracker(model, lens, config.estimator.gate_px)
        self.shape = config.camera.height_px, config.camera.width_px
        truth = Pose2(*(float(value) for value in HERE[:3]))
        self.leds_px = lens.to_pixels(features_at(config.leds.points, truth, config.camera.mount))
        found = self.tracker.follow(self.picture(self.leds_px), RULE, HERE, np.full(4, np.nan), 0)
        assert isinstance(found, Followed)
        self.mass = found.mass

    def picture(self, pixels: Array, spread_px: tuple[float, float] = (1.5, 1.5), grey: float = 200.0) -> Image:
        v, u = np.mgrid[: self.shape[0], : self.shape[1]]
        image = np.full(self.shape, 5.0)
        for x, y in pixels:
            near = np.s_[max(int(y) - 20, 0) : int(y) + 21, max(int(x) - 20, 0) : int(x) + 21]
            square = ((u[near] - x) / spread_px[0]) ** 2 + ((v[near] - y) / spread_px[1]) ** 2
            image[near] = np.maximum(image[near], 5.0 + grey * np.exp(-0.5 * square))
        return np.asarray(np.rint(image), dtype=np.uint8)

    def follow(self, image: Image, expected: Array = HERE) -> Followed | int:
        return self.tracker.follow(image, RULE, expected, self.mass, 0)


@pytest.fixture(scope="module")
def sky(config: Config) -> Sky:
    return Sky(config)


def test_a_shift_of_the_whole_array_is_followed(sky: Sky) -> None:
    found = sky.follow(sky.picture(sky.leds_px + np.array([1.0, 4.0])))  # the camera pitched by 0.6°
    assert isinstance(found, Followed)
    assert np.isfinite(found.features).all()
    assert found.fitted.pitch_rad == pytest.approx(4.0 / 369.5, abs=2e-3)


def test_an_led_that_moves_on_its_own_is_left_out(sky: Sky) -> None:
    for led in range(4):
        moved = sky.leds_px.copy()
        moved[led] += [6.0, 0.0]
        found = sky.follow(sky.picture(moved))
        assert isinstance(found, Followed)
        assert np.flatnonzero(np.isnan(found.features[:, 0])).tolist() == [led]


def test_an_led_off_by_less_than_the_common_gate_is_found_by_the_fit_and_left_out(sky: Sky) -> None:
    moved = sky.leds_px.copy()
    moved[0] += [0.0, 2.2]
    found = sky.follow(sky.picture(moved))
    assert isinstance(found, Followed)
    assert np.isnan(found.features[0]).all()
    assert found.fitted.pose.y_m == pytest.approx(HERE[1], abs=0.02)


def test_where_it_is_ambiguous_which_led_is_off_none_is_believed(sky: Sky) -> None:
    moved = sky.leds_px.copy()
    moved[3] += [2.2, 0.0]  # without LED 3 or without another, the rest would fit about as well
    assert sky.follow(sky.picture(moved)) == 4


def test_four_that_agree_on_no_pose_are_not_the_array(sky: Sky) -> None:
    strained = sky.leds_px + np.array([[2.0, 0.0], [-2.0, 0.0], [2.0, 0.0], [-2.0, 0.0]])
    assert sky.follow(sky.picture(strained)) == 4


def test_spots_of_another_brightness_are_not_the_leds(sky: Sky) -> None:
    assert isinstance(sky.follow(sky.picture(sky.leds_px, grey=150.0)), Followed)
    assert sky.follow(sky.picture(sky.leds_px, grey=60.0)) == 4


def test_streaks_are_not_the_leds(sky: Sky) -> None:
    streak = (2.7, 0.9)  # as bright in all as the LEDs, of three times the length
    assert sky.follow(sky.picture(sky.leds_px, streak)) == 4


def test_a_pose_where_the_robot_cannot_be_is_not_followed(sky: Sky) -> None:
    near, away = (HERE + np.array([metres, 0.0, 0.0, 0.0, 0.0]) for metres in (0.02, 0.3))
    assert isinstance(sky.follow(sky.picture(sky.leds_px), near), Followed)
    assert sky.follow(sky.picture(sky.leds_px), away) == 4


def test_two_leds_are_too_few(sky: Sky) -> None:
    assert isinstance(sky.follow(sky.picture(sky.leds_px[:3])), Followed)
    assert sky.follow(sky.picture(sky.leds_px[:2])) == 2


def test_the_shift_under_which_most_leds_have_a_spot_wins() -> None:
    predicted = np.array([[0.0, 0.0], [50.0, 0.0], [50.0, 50.0], [0.0, 50.0]])
    lamp_near_the_first = np.array([0.5, 0.5])
    spots = np.vstack([predicted + np.array([6.0, 3.0]), lamp_near_the_first])
    allowed = np.hypot(*(spots[None] - predicted[:, None]).transpose(2, 0, 1)) <= 12.0
    assert nearest_within(predicted, spots, 12.0)[0] == 4
    assert moved_together(predicted, spots, allowed, 2.5) == [0, 1, 2, 3]
    allowed[2] = False
    assert moved_together(predicted, spots, allowed, 2.5) == [0, 1, -1, 3]
