"""The approach of a recording: images and wheels as they were, for these robots only."""

from __future__ import annotations

import numpy as np
import pytest

from common.errors import ConfigError
from common.geometry import Array, Pose2, features_at
from common.kinematics import path_from_wheels
from station.calibrate.recorded_drive import recorded_drive
from tests.rigs.recorded_run import recorded_run, recording_config


def test_images_and_wheels_of_the_approach_are_those_of_the_run() -> None:
    config = recording_config()
    drive = recorded_drive(recorded_run(), config)
    assert (np.diff(drive.frames_ns) > 0).all()
    assert (np.diff(drive.wheels_ns) > 0).all()
    first, last = drive.poses[0], drive.poses[-1]
    driven = path_from_wheels(config.base, tuple(drive.wheel_angle_rad[-1] - drive.wheel_angle_rad[0]))[0]
    assert first[0] - last[0] == pytest.approx(driven, abs=0.05)
    assert driven > 0.05
    from_pose = features_at(config.leds.points, _pose(last), config.camera.mount)
    assert drive.features[-1] == pytest.approx(from_pose, abs=0.01)


def test_a_recording_of_another_camera_is_refused() -> None:
    other = recording_config("camera.mount_xyz_m=[0.25, 0.01, 1.20]")
    with pytest.raises(ConfigError, match="recorded with another lens, mounting or array"):
        recorded_drive(recorded_run(), other)


def _pose(row: Array) -> Pose2:
    return Pose2(*row.tolist())
