"""The retry with another exposure: once, kept while it helps, taken back where it does not; and that it helps."""

from __future__ import annotations

import numpy as np
import pytest

from common.config import Config
from common.frames.ring import Image
from common.geometry import Pose2
from common.messages import Frame, StateCause
from experiments.shared.steady import steady
from follower.camera.exposure import FACTOR, ExposureRetry
from follower.estimator.state import StateEstimator
from sim.optics.image import Optics, View
from sim.optics.scenes import Scene

FRAME_NS = 16_666_667
CONFIGURED_US = 600.0


class FedRetry:
    """The retry, given one cause for some frames at a time."""

    def __init__(self) -> None:
        self.retry = ExposureRetry(CONFIGURED_US, 60.0)
        self.frame = 0

    def by(self, cause: StateCause, frames: int) -> list[float]:
        begin, self.frame = self.frame, self.frame + frames
        return [self.retry.judge(number * FRAME_NS, cause) for number in range(begin, self.frame)]


@pytest.mark.parametrize(("cause", "factor"), [("underexposed", FACTOR), ("overexposed", 1.0 / FACTOR)])
def test_after_100_ms_one_other_exposure_is_tried_and_taken_back(cause: StateCause, factor: float) -> None:
    retry = FedRetry()
    assert set(retry.by("ok", 10) + retry.by(cause, 6)) == {CONFIGURED_US}
    assert set(retry.by(cause, 30)[1:]) == {factor * CONFIGURED_US}
    assert set(retry.by(cause, 200)[2:]) == {CONFIGURED_US}, "no second try"
    retry.by("ok", 1)
    assert factor * CONFIGURED_US in retry.by(cause, 10), "seen meanwhile: another one"


def test_an_exposure_that_helps_stays_while_it_helps() -> None:
    retry = FedRetry()
    retry.by("underexposed", 10)
    assert set(retry.by("confirming", 5) + retry.by("ok", 300)) == {FACTOR * CONFIGURED_US}
    assert set(retry.by("few_leds", 20)) == {FACTOR * CONFIGURED_US}, "a passer-by hides LEDs"
    assert retry.by("few_leds", 40)[-1] == CONFIGURED_US
    assert retry.by("underexposed", 10)[-1] == FACTOR * CONFIGURED_US, "it has helped before"


def test_an_exposure_stays_while_the_light_code_is_awaited() -> None:
    retry = FedRetry()
    retry.by("underexposed", 10)
    assert set(retry.by("confirming", 120) + retry.by("ok", 10)) == {FACTOR * CONFIGURED_US}


def test_a_glimpse_of_bad_light_changes_nothing() -> None:
    retry = FedRetry()
    for _ in range(20):
        assert set(retry.by("overexposed", 5) + retry.by("few_leds", 5)) == {CONFIGURED_US}


def test_light_that_is_bad_but_for_a_frame_counts_as_bad() -> None:
    retry = FedRetry()
    for _ in range(3):
        retry.by("underexposed", 4)
        retry.by("few_leds", 1)
    assert retry.by("underexposed", 1) == [FACTOR * CONFIGURED_US]


def test_an_exposure_never_outlasts_its_frame() -> None:
    retry = ExposureRetry(10_000.0, 60.0)
    longest = [retry.judge(number * FRAME_NS, "underexposed") for number in range(10)][-1]
    assert 10_000.0 < longest < 1e6 / 60.0


@pytest.mark.parametrize(("darkened", "distance_m"), [(0.05, 8.0), (0.05, 6.0)])
def test_leds_too_dim_are_underexposed_and_the_retry_finds_them(
    config: Config, darkened: float, distance_m: float
) -> None:
    estimator, optics = StateEstimator(steady(config)), Optics(config.camera, config.leds, 1)
    retry = ExposureRetry(config.camera.exposure_us, config.camera.rate_hz)
    image: Image = np.zeros((config.camera.height_px, config.camera.width_px), np.uint8)
    exposure_us, causes = config.camera.exposure_us, []
    for sequence in range(1, 40):
        light = darkened * exposure_us / config.camera.exposure_us
        optics.render(
            image, View(sequence, Pose2(distance_m, 0.2, 0.05), (1.0,) * 4, scene=Scene(exposure_factor=light))
        )
        camera = config.camera
        note = Frame(
            sequence, 0, sequence * FRAME_NS, "x", camera.width_px, camera.height_px, exposure_us, camera.gain
        )
        state = estimator.step(note, image, (0.0, 0.0), None)
        causes.append(state.cause)
        exposure_us = retry.judge(sequence * FRAME_NS, state.cause)
    assert set(causes[:6]) == {"underexposed"}
    assert causes[-1] == "ok"
    assert exposure_us == FACTOR * config.camera.exposure_us
