"""Where the camera sits, and the desired image: recovered from what is seen, refused when it cannot be trusted."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from common.config import CameraConfig, Config
from common.errors import ConfigError
from common.geometry import Array, Pose2, features_at
from follower.estimator.lens import Lens
from follower.supervisor.taught import calibration_hash, load, save
from station.calibrate.mount import MountError, View, averaged, calibrate_mount, project, whole_tilt_rad
from station.calibrate.mount_file import load_views, save_views
from station.calibrate.teach import TeachError, teach

FOCAL_PX = 369.5
TRUTH = np.array([0.262, 0.008, 1.187, math.radians(0.6), math.radians(-0.4), math.radians(0.3)])
POSES = [
    Pose2(1.5, 0.0, 0.0),
    Pose2(2.0, 0.3, 0.2),
    Pose2(2.5, -0.4, -0.2),
    Pose2(3.5, 0.5, 0.0),
    Pose2(1.8, -0.2, 0.3),
]


def views(config: Config, noise_px: float = 0.05, poses: list[Pose2] = POSES) -> list[View]:
    draws = np.random.default_rng(2)
    noise = noise_px / FOCAL_PX
    return [View(pose, project(config.leds.points, pose, TRUTH) + draws.normal(0.0, noise, (4, 2))) for pose in poses]


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
        View(pose, Lens(camera).to_normalised(camera.pinhole.to_pixels(project(config.leds.points, pose, truth))))
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
    save_views([View(Pose2(2.0, 0.3, 0.1), mean)], path)
    (again,) = load_views(path, 4)
    assert again.relative.as_array() == pytest.approx([2.0, 0.3, 0.1])
    assert again.features == pytest.approx(mean, nan_ok=True)
    with pytest.raises(ConfigError, match=r"views\.json: view 1 .* each of the 5 LEDs"):
        load_views(path, 5)
    with pytest.raises(MountError, match="5 frames"):
        averaged(features[:5], FOCAL_PX)
    with pytest.raises(MountError, match="robots at rest"):
        averaged([one + 1e-3 * k for k, one in enumerate(features)], FOCAL_PX)


@pytest.mark.parametrize(
    ("pose", "point"), [("[NaN, 0, 0]", "[0, 0]"), ("[2, 0, Infinity]", "[0, 0]"), ("[2, 0, 0]", "[0, Infinity]")]
)
def test_views_that_are_no_numbers_are_named(tmp_path: Path, pose: str, point: str) -> None:
    path = tmp_path / "views.json"
    view = '{"pose": [2, 0, 0], "features": [null, [0, 0]]}'
    path.write_text(f'[{view}, {{"pose": {pose}, "features": [null, {point}]}}]', encoding="utf-8")
    with pytest.raises(ConfigError, match=r"views\.json: view 2: .* not finite"):
        load_views(path, 2)


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
        View(Pose2(view.relative.x_m, view.relative.y_m + 0.05 * (-1) ** k, view.relative.theta_rad), view.features)
        for k, view in enumerate(views(config))
    ]
    with pytest.raises(MountError, match="residual of"):
        calibrate_mount(wrong, points, start, FOCAL_PX)


def docked(config: Config, count: int = 40, noise_px: float = 0.05) -> tuple[list[Array], list[Pose2]]:
    draws = np.random.default_rng(1)
    clean = features_at(config.leds.points, Pose2(1.51, 0.0, 0.0), config.camera.mount)
    features = [clean + draws.normal(0.0, noise_px / FOCAL_PX, clean.shape) for _ in range(count)]
    return features, [Pose2(1.51, 0.0, 0.0)] * count


def test_taught_image_is_the_average_and_is_compared_with_geometry(config: Config) -> None:
    taught = teach(config, 1, *docked(config))
    clean = features_at(config.leds.points, Pose2(1.51, 0.0, 0.0), config.camera.mount)
    assert taught.features == pytest.approx(clean, abs=5e-5)
    assert 0.5 < taught.offset_px < 5.0
    assert taught.pose.x_m == pytest.approx(1.51)


def test_unsteady_or_incomplete_frames_are_refused(config: Config) -> None:
    features, poses = docked(config)
    with pytest.raises(TeachError, match="5 of 5 frames show every LED, at least 30"):
        teach(config, 1, features[:5], poses[:5])
    with pytest.raises(TeachError, match="features move by"):
        teach(config, 1, [one + 3e-4 * k for k, one in enumerate(features)], poses)
    with pytest.raises(TeachError, match=r"0 of 40 frames .*: LED 2 is not always seen"):
        teach(config, 1, [np.where(np.arange(4)[:, None] == 2, np.nan, one) for one in features], poses)


def test_a_few_coasting_frames_are_left_out(config: Config) -> None:
    features, poses = docked(config)
    features[7] = features[20] = np.full((4, 2), np.nan)
    poses[7] = Pose2(9.0, 9.0, 1.0)
    taught = teach(config, 1, features, poses)
    assert taught.frames == 38
    assert taught.pose.x_m == pytest.approx(1.51)


def test_frames_without_the_array_name_no_led(config: Config) -> None:
    features, poses = docked(config)
    with pytest.raises(TeachError, match=r"0 of 40 frames show every LED, at least 30 are needed$"):
        teach(config, 1, [np.full_like(one, np.nan) for one in features], poses)


def test_taught_image_is_kept_and_refused_under_another_calibration(config: Config, tmp_path: Path) -> None:
    path = tmp_path / "docking1.json"
    taught = teach(config, 1, *docked(config))
    save(taught, path)
    again = load(path, config.camera)
    assert again.features == pytest.approx(taught.features)
    assert (again.pose, again.trolley, again.calibration) == (taught.pose, 1, calibration_hash(config.camera))
    for change in ({"mount_xyz_m": (0.25, 0.0, 1.21)}, {"mount_tilt_deg": (0.5, 0.0, 0.0)}, {"width_px": 1024}):
        moved = CameraConfig.model_validate({**config.camera.model_dump(), **change})
        with pytest.raises(ConfigError, match="another lens or mounting: teach docking 1 again"):
            load(path, moved)
    for broken in ("", "[]", '{"schema": "taught/1"}', '{"schema": "x"}'):
        path.write_text(broken)
        with pytest.raises(ConfigError, match=r"docking1\.json"):
            load(path, config.camera)
