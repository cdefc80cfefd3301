"""The drive and light of a robot that is not as configured."""

from __future__ import annotations

import numpy as np
import pytest

from common.config import Config
from common.geometry import Pose2
from experiments.tolerance.world import SPOT_PX, TrueRobot
from follower.estimator.lens import Lens
from follower.model.array import LedArray
from sim.truth import Truth
from sim.world_config import world_config

START = Pose2(-3.0, 0.1, 0.0)


def robot(config: Config, truth: Truth | None = None, seed: int = 1) -> TrueRobot:
    return TrueRobot(config, world_config(config, "test"), truth or Truth(), START, [seed])


def driven(config: Config, truth: Truth) -> TrueRobot:
    made = robot(config, truth)
    made.command((0.2, 0.1))
    made.advance(2.0)
    return made


def test_an_exact_robot_sees_what_the_model_says(config: Config) -> None:
    made = robot(config)
    features, _, _ = LedArray(config.leds.points, config.camera.mount).project(START.inverse().as_array()[None])
    exact = Lens(config.camera).to_pixels(features[0].T)
    assert made.seen_from(START.inverse()) == pytest.approx(exact, abs=1e-6)
    spread = np.array([made.pixels() - exact for _ in range(300)]).std()
    assert spread == pytest.approx(SPOT_PX, rel=0.1)


def test_the_same_seed_gives_the_same_image(config: Config) -> None:
    assert (robot(config).pixels() == robot(config).pixels()).all()
    assert (robot(config, seed=2).pixels() != robot(config).pixels()).any()


def test_encoders_count_what_the_floor_does_not_get(config: Config) -> None:
    exact, larger = driven(config, Truth()), driven(config, Truth(wheel_radius=(0.02, 0.02)))
    assert larger.wheel_angle_rad == exact.wheel_angle_rad
    assert larger.wheels == exact.wheels
    way = [abs(START.inverse().compose(made.follower_in_leader).x_m) for made in (exact, larger)]
    assert way[1] / way[0] == pytest.approx(1.02, abs=0.002)


def test_unequal_wheels_and_a_wider_track_change_the_turn(config: Config) -> None:
    exact = driven(config, Truth()).follower_in_leader.theta_rad
    assert driven(config, Truth(track=0.03)).follower_in_leader.theta_rad == pytest.approx(exact / 1.03, rel=1e-3)
    assert driven(config, Truth(wheel_radius=(0.0, 0.02))).follower_in_leader.theta_rad > exact + 0.01


def test_late_light_shows_an_earlier_place(config: Config) -> None:
    prompt, late = driven(config, Truth()), driven(config, Truth(latency_ms=40.0))
    before = robot(config)
    before.command((0.2, 0.1))
    before.advance(1.96)
    there = np.array([late.pixels() for _ in range(200)]).mean(axis=0)
    assert there == pytest.approx(before.seen_from(before.follower_in_leader.inverse()), abs=0.1)
    assert there != pytest.approx(prompt.seen_from(prompt.follower_in_leader.inverse()), abs=0.5)
