"""Does the image move as the wheels do: from features alone, at the edges of what a camera and a floor do."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from common.config import Config
from common.geometry import Array, Pose2, move_relative
from follower.estimator.image_health import ImageFollows
from follower.model.array import LedArray

FRAME_S, FRAME_NS = 1 / 60, 16_666_667
Twist = tuple[float, float]


@dataclass
class Drive:
    """A robot in front of the array; ``frames`` of it go through the detector."""

    config: Config
    pose: Pose2
    noise_px: float = 0.05
    pitch_rad: float = 0.0
    lost: tuple[int, ...] = ()
    every: int = 1
    frozen: bool = False
    number: int = 0
    seen: Array | None = None
    draws: np.random.Generator = field(default_factory=lambda: np.random.default_rng(4))

    def __post_init__(self) -> None:
        camera, leds = self.config.camera, self.config.leds
        sigma = self.config.estimator.pixel_sigma_px / camera.lens.fx_px
        self.array = LedArray(leds.points, camera.mount)
        self.follows = ImageFollows(camera.mount[2] - leds.points[:, 2], camera.mount, sigma)

    def frames(self, count: int, wheels: Twist, moves: Twist | None = None) -> list[bool]:
        """Whether it is doubted, frame by frame; ``moves``: how the robot really moves."""
        verdicts = []
        for _ in range(count):
            self.number += 1
            self.pose = move_relative(self.pose, *(moves or wheels), FRAME_S)
            if self.number % self.every == 0:
                verdicts.append(self.follows.doubted(self.features(), wheels, self.number * FRAME_NS))
        return verdicts

    def features(self) -> Array:
        if self.seen is None or not self.frozen:
            shake = self.pitch_rad * math.sin(0.7 * self.number)
            state = [*self.pose.as_array(), shake, 0.7 * shake]
            self.seen = self.array.project(np.array([state]))[0][0].T
        sigma = self.noise_px / self.config.camera.lens.fx_px
        features: Array = self.seen + self.draws.normal(0.0, sigma, self.seen.shape)
        features[list(self.lost)] = np.nan
        return features


# far and fast, on the way, last metre, insertion; and the most frames until it is noticed
PLACES = [
    (Pose2(9.0, 0.5, 0.1), (0.5, 0.02), 24),
    (Pose2(3.3, 0.2, 0.05), (0.4, 0.05), 6),
    (Pose2(2.1, 0.05, 0.02), (0.1, 0.01), 6),
    (Pose2(1.5, 0.0, 0.0), (0.05, 0.0), 7),
]


@pytest.mark.parametrize(("pose", "twist", "most"), PLACES)
def test_a_living_image_follows_and_a_frozen_one_is_noticed(
    config: Config, pose: Pose2, twist: Twist, most: int
) -> None:
    drive = Drive(config, pose)
    assert not any(drive.frames(60, twist))
    drive.frozen, drive.noise_px = True, 0.01
    assert drive.frames(most, twist)[-1]
    assert all(drive.frames(60, twist)), "and stays so while the wheels turn"


@pytest.mark.parametrize("trouble", [{"noise_px": 0.1}, {"pitch_rad": 0.004}, {"every": 3}, {"lost": (1,)}])
@pytest.mark.parametrize(("pose", "twist", "most"), PLACES)
def test_noise_pitch_roll_lost_frames_and_leds_are_no_doubt(
    config: Config, pose: Pose2, twist: Twist, most: int, trouble: dict[str, Any]
) -> None:
    drive = replace(Drive(config, pose), **trouble)
    assert not any(drive.frames(120, twist))
    drive.frozen, drive.noise_px = True, 0.01
    assert drive.frames(most + 6, twist)[-1]


@pytest.mark.parametrize(("share", "doubted"), [(1.3, False), (0.6, False), (0.4, False), (0.0, True)])
def test_only_wheels_that_slip_almost_wholly_are_in_doubt(config: Config, share: float, doubted: bool) -> None:
    drive = Drive(config, Pose2(3.0, 0.1, 0.0))
    assert any(drive.frames(60, (0.3, 0.0), (0.3 * share, 0.0))) == doubted


@pytest.mark.parametrize("wheels", [(0.0, 0.0), (0.0, 0.2), (0.0, -0.3), (0.0005, 0.0)])
def test_who_stands_turns_in_place_or_as_good_as_stands_is_not_judged(config: Config, wheels: Twist) -> None:
    drive = Drive(config, Pose2(3.0, 0.1, 0.0), frozen=True)
    assert not any(drive.frames(180, wheels))


def test_a_turn_that_a_drift_undoes_is_no_doubt(config: Config) -> None:
    drive = Drive(config, Pose2(6.0, 0.3, 0.1))
    assert not any(drive.frames(180, (0.4, 0.1), (0.4, 0.0)))


def test_a_start_that_the_image_shows_late_is_no_doubt(config: Config) -> None:
    drive = Drive(config, Pose2(1.4, 0.0, 0.0))
    speeds = [min(0.05, 0.3 * n * FRAME_S) for n in range(60)]
    late = [0.0, 0.0, *speeds]
    assert not any(
        drive.frames(1, (v, 0.0), (really, 0.0))[0] for v, really in zip(speeds, late[: len(speeds)], strict=True)
    )


def test_one_led_or_none_is_no_evidence(config: Config) -> None:
    for lost in ((0, 1, 2), (0, 1, 2, 3)):
        drive = Drive(config, Pose2(2.0, 0.0, 0.0), lost=lost, frozen=True)
        assert not any(drive.frames(60, (0.1, 0.0)))


def test_the_doubt_ends_with_motion_that_follows_or_half_a_second_of_standing(config: Config) -> None:
    drive = Drive(config, Pose2(2.1, 0.0, 0.0), frozen=True)
    assert drive.frames(30, (0.1, 0.0))[-1]
    drive.frozen = False
    assert drive.frames(1, (0.1, 0.0))[-1]
    assert not drive.frames(8, (0.1, 0.0))[-1]
    drive.frozen = True
    assert drive.frames(10, (0.1, 0.0))[-1]
    still = drive.frames(40, (0.0, 0.0))
    assert still.index(False) in (30, 31)
    assert not any(still[31:])


def test_a_gap_of_frames_begins_again(config: Config) -> None:
    drive = Drive(config, Pose2(2.1, 0.0, 0.0))
    drive.frames(30, (0.1, 0.0))
    drive.number += 60
    drive.frozen = True
    assert not any(drive.frames(3, (0.1, 0.0)))
    assert drive.frames(8, (0.1, 0.0))[-1]
