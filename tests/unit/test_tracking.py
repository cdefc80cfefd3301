"""Prediction of features and assignment of spots to them."""

from __future__ import annotations

import numpy as np
import pytest

from common.config import Config
from common.geometry import Pose2, features_at, move_relative
from follower.estimator.tracking import nearest_within, predict_features


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
