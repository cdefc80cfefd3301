"""Where the camera sits: recovered from what is seen, refused when it cannot be trusted."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from common.config import CameraConfig, Config
from common.errors import ConfigError
from common.geometry import Pose2, features_at
from follower.estimator.lens import Lens
from station.calibrate.mount import MountError, MountView, averaged, calibrate_mount, project, whole_tilt_rad
from station.calibrate.mount_file import load_views, save_views
from tests.rigs.mount_rig import FOCAL_PX, docked

TRUTH = np.array([0.262, 0.008, 1.187, math.radians(0.6), math.radians(-0.4), math.radians(0.3)])
POSES = [
    Pose2(1.5, 0.0, 0.0),
    Pose2(2.0, 0.3, 0.2),
    Pose2(2.5, -0.4, -0.2),
    Pose2(3.5, 0.5, 0.0),
    Pose2(1.8, -0.2, 0.3),
]


def views(config: Config, noise_px: float = 0.05, poses: list[Pose2] = POSES) -> list[MountView]:
    draws = np.random.default_rng(2)
    noise = noise_px / FOCAL_PX
    return [
        MountView(pose, project(config.leds.points, pose, TRUTH) + draws.normal(0.0, noise, (4, 2))) for pose in poses
    ]


def test_mount_is_recovered_within_its_own_sigma(config: Config) -> None:
    mount = calibrate_mount(views(config), config.leds.points, config.camera.mount, FOCAL_PX)
    found = np.array([*mount.xyz_m, mount.pitch_rad, mount.roll_rad, mount.yaw_rad])
    assert np.all(np.abs(found - TRUTH) < 4.0 * mount.sigma)
    assert np.all(np.abs(found - TRUTH)[:3] < 0.005)
    assert mount.residual_px < 0.1


def test_a_tilt_already_configured_is_part_of_the_whole(config: Config) -> None:
    whole = np.radians([3.4, -0.7, 1.2])
    configured = np.radians([3.0, -1.0, 1.5])
    camera = CameraConfig.model_validate(
        {**config.camera.model_dump(), "mount_tilt_deg": tuple(float(value) for value in np.degrees(configured))}
    )
    truth = np.array([*config.camera.mount, *whole])
    levelled = [
        MountView(
            pose, Lens(camera).to_normalised(camera.pinhole.to_pixels(project(config.leds.points, pose, truth)))
        )
        for pose in POSES
    ]
    mount = calibrate_mount(levelled, config.leds.points, camera.mount, FOCAL_PX)
    assert abs(mount.pitch_rad) < math.radians(0.6), "only what is left over was seen"
    assert whole_tilt_rad(mount, camera.mount_tilt) == pytest.approx(whole, abs=1e-6)
    assert whole_tilt_rad(mount, np.zeros(3)) == pytest.approx([mount.pitch_rad, mount.roll_rad, mount.yaw_rad])


def test_a_view_is_the_average_of_a_robot_at_rest(config: Config, tmp_path: Path) -> None:
    features, _ = docked(config)
    features[3] = np.full((4, 2), np.nan)
    for one in features:
        one[1] = np.nan
    mean = averaged(features, FOCAL_PX)
    assert np.isnan(mean[1]).all()
    assert np.isfinite(mean[[0, 2, 3]]).all()
    path = tmp_path / "views.json"
    save_views([MountView(Pose2(2.0, 0.3, 0.1), mean)], path)
    (again,) = load_views(path, 4)
    assert again.relative.as_array() == pytest.approx([2.0, 0.3, 0.1])
    assert again.features == pytest.approx(mean, nan_ok=True)
    with pytest.raises(ConfigError, match=r"views\.json: view 1 .* each of the 5 LEDs"):
        load_views(path, 5)
    with pytest.raises(MountError, match="5 frames"):
        averaged(features[:5], FOCAL_PX)
    with pytest.raises(MountError, match="robots at rest"):
        averaged([one + 1e-3 * k for k, one in enumerate(features)], FOCAL_PX)


def test_untilted_mount_is_the_papers_projection(config: Config) -> None:
    state = np.array([*config.camera.mount, 0.0, 0.0, 0.0])
    assert project(config.leds.points, POSES[1], state) == pytest.approx(
        features_at(config.leds.points, POSES[1], config.camera.mount)
    )


def test_mount_refuses_what_does_not_determine_it(config: Config) -> None:
    points, start = config.leds.points, config.camera.mount
    with pytest.raises(MountError, match="3 poses, at least 4"):
        calibrate_mount(views(config)[:3], points, start, FOCAL_PX)
    near = [Pose2(1.5 + 0.01 * k, 0.0, 0.0) for k in range(5)]
    with pytest.raises(MountError, match=r"within 0\.04 m"):
        calibrate_mount(views(config, poses=near), points, start, FOCAL_PX)
    wrong = [
        MountView(
            Pose2(view.relative.x_m, view.relative.y_m + 0.05 * (-1) ** k, view.relative.theta_rad), view.features
        )
        for k, view in enumerate(views(config))
    ]
    with pytest.raises(MountError, match="residual of"):
        calibrate_mount(wrong, points, start, FOCAL_PX)
