"""The desired image: an average of what is seen, refused when it cannot be trusted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from common.config import CameraConfig, Config
from common.errors import ConfigError
from common.geometry import Pose2, features_at
from follower.estimator.lens import Lens
from follower.model.taught import calibration_hash, geometry_tag, load, save, taught_robots
from station.calibrate.teach import TeachError, as_configured, teach
from tests.rigs.mount_rig import docked


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


def test_features_of_a_corrected_estimator_are_stored_as_configured(config: Config, tmp_path: Path) -> None:
    path = tmp_path / "robots.toml"
    save(teach(config, 1, *docked(config)), tmp_path / "taught-1.json")
    robots = config.model_copy(update={"docking": config.docking.model_copy(update={"taught_dir": str(tmp_path)})})
    corrected = taught_robots(robots, path)
    features, _ = docked(config)
    seen = [Lens(corrected.camera).to_normalised(Lens(config.camera).to_pixels(one)) for one in features]
    assert as_configured(robots, path, geometry_tag(corrected), seen)[0] == pytest.approx(features[0])
    assert as_configured(robots, path, geometry_tag(robots), features)[0] is features[0]
    with pytest.raises(TeachError, match="restart it, then teach"):
        as_configured(robots, path, "0123456789abcdef", features)
