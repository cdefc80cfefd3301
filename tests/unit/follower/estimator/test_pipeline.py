"""Perception from rendered frames: a whole approach, bad images, and what is said of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from common.config import Config
from common.geometry import Pose2, features_at, move_relative
from follower.estimator.detection import Detection
from follower.estimator.image_health import ImageHealth
from follower.estimator.pipeline import Perception
from sim.optics.image import Optics, View

PERIOD_NS = 16_666_667
CURRENTS = (1.0, 1.0, 1.0, 1.0)
Shoot = Callable[[Pose2, int], "np.ndarray[tuple[int, int], np.dtype[np.uint8]]"]


@pytest.fixture(scope="module")
def shoot(config: Config) -> Shoot:
    optics = Optics(config.camera, config.leds, seed=1)

    def render(pose: Pose2, sequence: int) -> np.ndarray[tuple[int, int], np.dtype[np.uint8]]:
        image = np.zeros((config.camera.height_px, config.camera.width_px), np.uint8)
        optics.render(image, View(sequence, pose, CURRENTS))
        return image

    return render


@pytest.mark.parametrize("method", ["paper", "davpc"])
def test_an_approach_is_followed_to_the_goal(config: Config, shoot: Shoot, method: str) -> None:
    tuned = config.model_copy(update={"estimator": config.estimator.model_copy(update={"method": method})})
    perception = Perception(tuned)
    pose, twist = Pose2(8.0, 0.6, 0.12), (0.45, 0.02)
    for sequence in range(1, 120):
        pose = move_relative(pose, *twist, 1 / 60)
        seen = perception.process(shoot(pose, sequence), sequence, sequence * PERIOD_NS, twist)
        if sequence < 8:
            continue
        assert seen.valid, seen.cause
        assert seen.leds_seen == 4
        assert seen.pose is not None
        assert seen.pose.theta_rad == pytest.approx(pose.theta_rad, abs=0.03)
        assert seen.features == pytest.approx(features_at(config.leds.points, pose, config.camera.mount), abs=6e-4)
        assert seen.residual_px < 0.3


def bad_images(config: Config) -> list[tuple[str, object]]:
    height, width = config.camera.height_px, config.camera.width_px
    return [
        ("no_frame", None),
        ("bad_frame", np.zeros((10, 10), np.uint8)),
        ("bad_frame", np.zeros((height, width), np.float64)),
        ("bad_frame", np.zeros((height, width, 3), np.uint8)),
        ("underexposed", np.zeros((height, width), np.uint8)),
        ("few_leds", np.full((height, width), 5, np.uint8)),
        ("overexposed", np.full((height, width), 255, np.uint8)),
    ]


def test_bad_images_are_named_never_raised(config: Config) -> None:
    for cause, image in bad_images(config):
        seen: Detection = Perception(config).process(image, 1, PERIOD_NS, (0.0, 0.0))  # type: ignore[arg-type]
        assert (seen.valid, seen.cause) == (False, cause)
        assert np.isnan(seen.features).all()


def test_an_image_of_noise_is_named_and_the_track_outlives_it(config: Config, shoot: Shoot) -> None:
    pose = Pose2(4.0, 0.0, 0.0)
    perception, last = locked(config, shoot, pose)
    lost = perception.process(
        shoot(Pose2(-4.0, 0.0, 0.0), last + 1), last + 1, (last + 1) * PERIOD_NS, (0.0, 0.0), None
    )
    assert lost.cause == "coasting"
    salt = np.where(np.random.default_rng(0).random((1024, 1280)) < 0.05, 255, 0).astype(np.uint8)
    fresh = Perception(config).process(salt, 1, PERIOD_NS, (0.0, 0.0))
    assert (fresh.valid, fresh.cause) == (False, "noisy")
    now = last + 2
    assert not perception.process(salt, now, now * PERIOD_NS, (0.0, 0.0)).valid
    assert perception.process(shoot(pose, now + 1), now + 1, (now + 1) * PERIOD_NS, (0.0, 0.0)).valid


def locked(config: Config, shoot: Shoot, pose: Pose2) -> tuple[Perception, int]:
    """A perception that has confirmed its lock at a standstill, and the number of its last frame."""
    perception = Perception(config)
    for sequence in range(1, 20):
        if perception.process(shoot(pose, sequence), sequence, sequence * PERIOD_NS, (0.0, 0.0)).valid:
            return perception, sequence
    raise AssertionError("no lock within 20 frames")


def test_a_lock_is_confirmed_before_it_is_used(config: Config, shoot: Shoot) -> None:
    _, frames = locked(config, shoot, Pose2(4.0, 0.0, 0.0))
    assert 3 <= frames <= 8


def test_what_the_wheels_cannot_explain_waits_until_the_track_is_forgotten(config: Config, shoot: Shoot) -> None:
    perception, last = locked(config, shoot, Pose2(4.0, 0.0, 0.0))
    there = Pose2(4.0, 0.9, 0.2)

    def look(sequence: int) -> Detection:
        return perception.process(shoot(there, sequence), sequence, sequence * PERIOD_NS, (0.0, 0.0))

    refused = [look(sequence) for sequence in range(last + 1, last + 100)]
    assert not any(seen.valid for seen in refused)
    assert refused[0].cause == "coasting"
    assert {seen.cause for seen in refused} == {"coasting", "ambiguous"}, "bright as ever: no matter of exposure"
    perception.forget_track()
    seen = [look(sequence) for sequence in range(last + 100, last + 106)][-1]
    assert seen.valid
    assert seen.pose is not None
    assert seen.pose.y_m == pytest.approx(0.9, abs=0.02)


def test_a_predicted_pose_serves_in_place_of_dead_reckoning(config: Config, shoot: Shoot) -> None:
    perception, last = locked(config, shoot, Pose2(4.0, 0.0, 0.0))
    dark = shoot(Pose2(-4.0, 0.0, 0.0), last + 1)
    unseen = perception.process(dark, last + 1, (last + 1) * PERIOD_NS, (0.0, 0.0))
    assert unseen.cause == "coasting"
    there, now = Pose2(3.8, 0.3, 0.1), last + 2
    seen = perception.process(shoot(there, now), now, now * PERIOD_NS, (0.0, 0.0), predicted=there)
    assert seen.valid
    assert seen.spots == 4


def test_a_frozen_camera_is_named(config: Config, shoot: Shoot) -> None:
    pose = Pose2(4.0, 0.0, 0.0)
    perception, last = locked(config, shoot, pose)
    still = shoot(pose, 999)
    causes = [perception.process(still, n, n * PERIOD_NS, (0.3, 0.0)).cause for n in range(last + 1, last + 5)]
    assert causes == ["ok", "ok", "frozen_camera", "frozen_camera"]


def test_features_that_stand_still_while_the_robot_moves_are_a_frozen_camera() -> None:
    features = np.array([[0.1, -0.2], [0.3, -0.2]])
    noise = np.random.default_rng(0)
    for moving, expected in ((True, [False] * 4 + [True]), (False, [False] * 5)):
        health = ImageHealth((64, 64))
        said = []
        for n in range(5):
            health.look(noise.integers(0, 9, (64, 64), dtype=np.uint8), n + 1)
            said.append(health.frozen(features.copy(), moving))
        assert said == expected


def test_a_frame_out_of_order_is_stale(config: Config, shoot: Shoot) -> None:
    perception, last = locked(config, shoot, Pose2(4.0, 0.0, 0.0))
    seen = perception.process(shoot(Pose2(4.0, 0.0, 0.0), 9), 9, last * PERIOD_NS, (0.0, 0.0))
    assert (seen.valid, seen.cause) == (False, "stale_frame")
