"""The simulated sensor: where specks lie, how bright they are, and that a frame can be repeated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from common.config import Config
from common.geometry import Pose2, features_at
from follower.estimator.planar_fit import FitModel, project
from sim.optics.image import Optics, View

FAR = View(frame_sequence=7, relative=Pose2(6.0, 0.0, 0.0), led_currents_a=(1.0, 1.0, 1.0, 1.0))


def at(x_m: float, y_m: float = 0.0, theta_rad: float = 0.0) -> View:
    return replace(FAR, relative=Pose2(x_m, y_m, theta_rad))


@pytest.fixture(scope="module")
def optics(config: Config) -> Optics:
    return Optics(config.camera, config.leds, seed=3)


def frame(config: Config, optics: Optics, view: View) -> np.ndarray[tuple[int, int], np.dtype[np.uint8]]:
    image = np.zeros((config.camera.height_px, config.camera.width_px), np.uint8)
    optics.render(image, view)
    return image


def test_same_sequence_same_pixels_next_sequence_others(config: Config, optics: Optics) -> None:
    again = Optics(config.camera, config.leds, seed=3)
    assert np.array_equal(frame(config, optics, FAR), frame(config, again, FAR))
    assert not np.array_equal(frame(config, optics, FAR), frame(config, optics, replace(FAR, frame_sequence=8)))


def test_specks_lie_where_the_papers_projection_puts_them(config: Config, optics: Optics) -> None:
    view = at(4.0, 0.7, 0.3)
    truth = config.camera.pinhole.to_pixels(
        features_at(config.leds.points, Pose2(4.0, 0.7, 0.3), config.camera.mount)
    )
    found = np.array([(speck.u_px, speck.v_px) for speck in optics.specks(view)])
    assert found == pytest.approx(truth, abs=1e-9)


def test_tilt_has_the_signs_that_the_fit_uses(config: Config, optics: Optics) -> None:
    view = replace(FAR, pitch_rad=0.02, roll_rad=-0.03)
    model = FitModel(config.leds.points, config.camera.mount, 1.0, 1.0)
    truth = config.camera.pinhole.to_pixels(project(model, np.array([[6.0, 0.0, 0.0, 0.02, -0.03]]))[0][0])
    found = np.array([(speck.u_px, speck.v_px) for speck in optics.specks(view)])
    assert found == pytest.approx(truth, abs=1e-9)
    level = np.array([(speck.u_px, speck.v_px) for speck in optics.specks(FAR)])
    assert np.all(found[:, 1].mean() > level[:, 1].mean()), "looking up moves the image down"


def test_brightness_follows_distance_current_and_beam(optics: Optics) -> None:
    near, far = optics.specks(at(4.0)), optics.specks(at(8.0))
    assert near[0].peak / far[0].peak == pytest.approx(4.0, rel=0.25)
    dim = optics.specks(replace(FAR, led_currents_a=(0.5, 1.0, 0.0, 1.0)))
    assert dim[0].peak == pytest.approx(0.5 * optics.specks(FAR)[0].peak)
    assert len(dim) == 3
    assert optics.specks(at(6.0, theta_rad=0.52))[0].peak == pytest.approx(0.5 * optics.specks(FAR)[0].peak, rel=0.25)


def test_leds_behind_and_from_behind_are_dark(config: Config, optics: Optics) -> None:
    assert optics.specks(at(-3.0)) == []
    assert optics.specks(at(6.0, theta_rad=3.1)) == []
    aside = frame(config, optics, at(0.5, 3.0))
    assert aside.max() < 30


def test_near_leds_saturate(config: Config, optics: Optics) -> None:
    image = frame(config, optics, at(1.5))
    assert (image == 255).sum() > 20
    assert image.dtype == np.uint8


def test_turning_smears_the_specks(config: Config) -> None:
    slow = Optics(config.camera.model_copy(update={"exposure_us": 20_000.0}), config.leds, seed=3)
    streak = slow.specks(replace(FAR, w_rad_s=0.5))[0].streak_px
    assert abs(streak[0]) == pytest.approx(0.5 * 0.02 * 369.5, rel=0.1)


def test_a_frame_of_another_size_is_refused(optics: Optics) -> None:
    with pytest.raises(ValueError, match="the camera has"):
        optics.render(np.zeros((10, 10), np.uint8), FAR)
