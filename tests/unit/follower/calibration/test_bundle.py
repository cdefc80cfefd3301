"""A robot is found from its own drives; poor coverage is refused."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from common.config import Config, default_config_path, load_config
from common.geometry import Array, Pose2
from common.timing import NS_PER_S
from follower.calibration.bundle import CoverageError, calibrate_robot
from follower.calibration.drive import Drive
from follower.calibration.model import RobotModel, moved
from follower.estimator.lens import Lens

RATE_HZ, DURATION_S, PIXEL = 30, 12.0, 0.05


@pytest.fixture(scope="module")
def config() -> Config:
    return load_config(default_config_path())


def drive_of(config: Config, errors: Array, side_m: float, seed: int) -> Drive:
    """An S-shaped approach of a robot with these errors, by the fit's own camera and wheels."""
    model = RobotModel(config)
    random = np.random.default_rng(seed)
    times = np.arange(round(RATE_HZ * DURATION_S)) / RATE_HZ
    v, w = np.full(len(times), 0.22), 0.15 * np.cos(times * 2 * math.pi / 6.0 + seed)
    late_s = float(model.values(errors)[-1])
    left, right, track = 1.0 + model.values(errors)[-4:-1]
    half = config.base.track_m * track / 2
    radius = config.base.wheel_radius_m
    turned = np.column_stack([(v - w * half) / left, (v + w * half) / right]) / radius
    wheels = np.cumsum(turned, axis=0) / RATE_HZ
    state = np.array([[4.6, side_m, 0.0]])
    poses = []
    for row in range(len(times)):
        state, _, _ = moved(state, np.array([[v[row], 0.0, w[row]]]) / RATE_HZ)
        poses.append(state[0])
    seen_at = np.array([np.interp(times - late_s, times, part) for part in np.array(poses).T]).T
    pixels = model.pixels(errors, np.column_stack([seen_at, np.zeros((len(times), 2))]))
    pixels += PIXEL * random.standard_normal(pixels.shape)
    features = Lens(config.camera).to_normalised(pixels.reshape(-1, 2)).reshape(pixels.shape)
    stamps = NS_PER_S + np.round(times * NS_PER_S).astype(np.int64)
    return Drive(stamps, features, np.array(poses), stamps, wheels)


def drives_of(config: Config, errors: Array) -> list[Drive]:
    return [drive_of(config, errors, side, seed) for seed, side in enumerate((-0.7, 0.6, 0.1, -0.3))]


def test_finds_the_errors_within_their_own_covariance(config: Config) -> None:
    random = np.random.default_rng(3)
    model = RobotModel(config)
    errors = random.uniform(-1.5, 1.5, model.size)
    found = calibrate_robot(drives_of(config, errors), config)
    z = (found.values - model.values(errors)) / found.sigma
    assert np.abs(z).max() < 3.5
    assert found.residual_px == pytest.approx(PIXEL, rel=0.2)


def test_says_what_the_drives_determine(config: Config) -> None:
    found = calibrate_robot(drives_of(config, np.zeros(RobotModel(config).size)), config)
    observable = dict(zip(found.names, found.observable, strict=True))
    assert observable["camera yaw"]
    assert observable["latency"]
    assert not observable["LED 1 y"]  # the array as a whole may stand anywhere in {L}


def test_an_outlier_in_some_images_changes_little(config: Config) -> None:
    drives = drives_of(config, np.zeros(RobotModel(config).size))
    spoiled = drives[0].features.copy()
    spoiled[::9, 2] += 0.02
    found = calibrate_robot([replace(drives[0], features=spoiled), *drives[1:]], config)
    assert (np.abs(found.values[:7]) < 4 * found.sigma[:7]).all()


@pytest.mark.parametrize(
    ("kept", "words"),
    [
        (lambda drives: drives[:2], "2 drives: record 3 or more"),
        (lambda drives: [drives[0]] * 3, "from side to side"),
        (lambda drives: [replace(drives[0], poses=drives[0].poses * [0.1, 1.0, 1.0]), *drives[1:]], "nearer"),
        (lambda drives: [replace(each, poses=each.poses * [1.0, 1.0, 0.01]) for each in drives], "turns"),
    ],
)
def test_refuses_poor_coverage(config: Config, kept: object, words: str) -> None:
    drives = drives_of(config, np.zeros(RobotModel(config).size))
    assert callable(kept)
    with pytest.raises(CoverageError, match=words):
        calibrate_robot(kept(drives), config)


def test_derivatives_of_a_motion_are_those_of_differences() -> None:
    state, motion = np.array([[2.0, 0.3, 0.2]]), np.array([[0.1, 0.02, 0.15]])
    _, by_pose, by_motion = moved(state, motion)
    for column, step in enumerate(1e-6 * np.eye(3)):
        assert (moved(state + step, motion)[0] - moved(state - step, motion)[0])[0] / 2e-6 == pytest.approx(
            by_pose[0, :, column], abs=1e-6
        )
        assert (moved(state, motion + step)[0] - moved(state, motion - step)[0])[0] / 2e-6 == pytest.approx(
            by_motion[0, :, column], abs=1e-6
        )


def test_a_pose_moves_as_poses_do() -> None:
    after, _, _ = moved(np.array([[2.0, 0.3, 0.2]]), np.array([[0.5, 0.1, 0.3]]))
    exact = Pose2(0.5, 0.1, 0.3).inverse().compose(Pose2(2.0, 0.3, 0.2))
    assert after[0] == pytest.approx(exact.as_array())
