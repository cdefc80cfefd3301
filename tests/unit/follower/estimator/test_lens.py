"""Lens: both directions undo one another, and agree with the simulator's own optics."""

from __future__ import annotations

import numpy as np
import pytest

from common.config import CameraConfig, Config, LensConfig
from common.geometry import Pose2, features_at
from follower.estimator.lens import Lens
from sim.optics.image import Optics, View
from sim.optics.lens import image_of_rays
from station.calibrate.mount import project

LENSES = [
    LensConfig(fx_px=369.5, fy_px=369.5, cx_px=640.0, cy_px=512.0),
    LensConfig(
        model="rational",
        fx_px=369.5,
        fy_px=370.5,
        cx_px=641.0,
        cy_px=510.0,
        coefficients=(0.21, 0.012, 0.0004, -0.0003, 0.0005, 0.53, 0.04, 0.001),
    ),
    LensConfig(
        model="fisheye",
        fx_px=420.0,
        fy_px=421.0,
        cx_px=639.0,
        cy_px=515.0,
        coefficients=(0.02, -0.004, 0.001, -0.0002),
    ),
]


def camera(config: Config, lens: LensConfig) -> CameraConfig:
    return CameraConfig.model_validate({**config.camera.model_dump(), "lens": lens})


@pytest.mark.parametrize("lens", LENSES, ids=lambda lens: lens.model)
def test_normalised_to_pixels_and_back(config: Config, lens: LensConfig) -> None:
    points = np.stack(np.meshgrid(np.linspace(-1.2, 1.2, 9), np.linspace(-0.9, 0.3, 7)), axis=-1).reshape(-1, 2)
    model = Lens(camera(config, lens))
    assert model.to_normalised(model.to_pixels(points)) == pytest.approx(points, abs=1e-6)


@pytest.mark.parametrize("lens", LENSES, ids=lambda lens: lens.model)
def test_agrees_with_the_simulated_sensor(config: Config, lens: LensConfig) -> None:
    rays = np.array([[0.0, 0.0, 1.0], [2.0, -1.0, 2.0], [-1.5, -0.5, 1.4]])
    simulated = image_of_rays(rays, camera(config, lens))
    assert Lens(camera(config, lens)).to_pixels(rays[:, :2] / rays[:, 2:]) == pytest.approx(simulated, abs=1e-6)


@pytest.mark.parametrize("lens", LENSES, ids=lambda lens: lens.model)
def test_the_mounting_is_taken_out(config: Config, lens: LensConfig) -> None:
    tilted = CameraConfig.model_validate(
        {**config.camera.model_dump(), "lens": lens, "mount_tilt_deg": (3.0, -2.0, 1.5)}
    )
    pose = Pose2(3.0, 0.3, 0.1)
    pixels, peaks = Optics(tilted, config.leds, seed=0).led_truth(View(1, pose, (1.0, 1.0, 1.0, 1.0)))
    assert np.all(peaks > 0)
    assert Lens(tilted).to_normalised(pixels) == pytest.approx(
        features_at(config.leds.points, pose, config.camera.mount), abs=1e-6
    )
    assert Lens(tilted).to_pixels(Lens(tilted).to_normalised(pixels)) == pytest.approx(pixels, abs=1e-3)


def test_mounting_angles_are_those_of_the_calibration(config: Config) -> None:
    pose, tilt = Pose2(3.0, 0.3, 0.1), np.radians([3.0, -2.0, 1.5])
    camera = CameraConfig.model_validate({**config.camera.model_dump(), "mount_tilt_deg": (3.0, -2.0, 1.5)})
    seen = project(config.leds.points, pose, np.array([*config.camera.mount, *tilt]))
    level = Lens(camera).to_normalised(camera.pinhole.to_pixels(seen))
    assert level == pytest.approx(features_at(config.leds.points, pose, config.camera.mount), abs=1e-9)
