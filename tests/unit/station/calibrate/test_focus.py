"""Focus help: better focus reads better, and the advice fits the image."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from common.config import Config
from common.frames.ring import Image
from common.geometry import Pose2
from follower.estimator.spots import SpotRule
from sim.optics.image import Optics, View
from station.calibrate.focus import focus_report

RULE = SpotRule(25, 2, 6000)


@pytest.fixture(scope="module")
def image(config: Config) -> Image:
    frame: Image = np.zeros((config.camera.height_px, config.camera.width_px), np.uint8)
    Optics(config.camera, config.leds, seed=1).render(frame, View(1, Pose2(6.0, 0.0, 0.0), (1.0, 1.0, 1.0, 1.0)))
    return frame


def test_blur_is_less_sharp_and_wider(image: Image) -> None:
    sharp = focus_report(image, RULE)
    soft = focus_report(np.asarray(cv2.GaussianBlur(image, (9, 9), 2.0), np.uint8), RULE)
    assert sharp.spots == soft.spots == 4
    assert sharp.sharpness > 2 * soft.sharpness
    assert sharp.spot_width_px < soft.spot_width_px
    assert "turn the lens" in sharp.advice


def test_advice_fits_the_image(image: Image) -> None:
    assert "no spots" in focus_report(np.zeros_like(image), RULE).advice
    assert "overexposed" in focus_report(np.full_like(image, 255), RULE).advice
    assert "filter" in focus_report(np.maximum(image, 90), SpotRule(130, 2, 6000)).advice
    assert "dim" in focus_report(image // 6, SpotRule(12, 2, 6000)).advice


def test_a_textured_image_as_without_the_filter_is_reported(image: Image) -> None:
    texture = np.random.default_rng(1).integers(0, 256, image.shape).astype(np.uint8)
    report = focus_report(texture, RULE)
    assert "is the filter in?" in report.advice
    assert (report.spots, report.sharpness) == (0, 0.0)
