"""Identification: right among clutter, and rather silent than wrong."""

from __future__ import annotations

import math

import numpy as np
import pytest

from common.config import Config
from common.geometry import Array, Pose2, features_at
from follower.estimator.identity.identification import Identifier, Limits, Match
from follower.estimator.planar_fit import FitModel, project

POSES = [
    Pose2(1.5, 0.0, 0.0),
    Pose2(3.0, 0.4, 0.3),
    Pose2(6.0, -1.5, -0.1),
    Pose2(7.4, 3.1, 0.52),
    Pose2(9.0, 0.0, 0.0),
]


def model(config: Config) -> FitModel:
    return FitModel(config.leds.points, config.camera.mount, 0.3 / 369.5, math.radians(0.7))


def shuffled(features: Array, clutter: Array, rng: np.random.Generator) -> tuple[Array, list[int]]:
    """All candidates in random order, and where the features went."""
    together = np.vstack([features, clutter])
    order = rng.permutation(len(together))
    return together[order], [int(np.flatnonzero(order == led)[0]) for led in range(len(features))]


def clutter(count: int, rng: np.random.Generator) -> Array:
    return np.column_stack([rng.uniform(-1.5, 1.5, count), rng.uniform(-0.9, 0.3, count)])


@pytest.mark.parametrize("pose", POSES, ids=str)
@pytest.mark.parametrize("count", [0, 10, 20])
def test_right_among_clutter(config: Config, pose: Pose2, count: int) -> None:
    rng = np.random.default_rng(count)
    state = np.array([[*pose.as_array(), 0.01, -0.01]])
    features = project(model(config), state)[0][0] + rng.normal(0.0, 0.1 / 369.5, (4, 2))
    candidates, rows = shuffled(features, clutter(count, rng), rng)
    found = Identifier(model(config), Limits()).identify(candidates, np.full(len(candidates), 500.0), False)
    assert isinstance(found, Match)
    assert list(found.spot_of_led) == rows
    assert found.pose.x_m == pytest.approx(pose.x_m, rel=0.1)


def test_never_wrong_in_many_scenes(config: Config) -> None:
    rng = np.random.default_rng(3)
    identifier = Identifier(model(config), Limits())
    right = 0
    for _ in range(120):
        bearing, distance = rng.uniform(-0.5, 0.5), rng.uniform(1.5, 9.0)
        pose = Pose2(distance * math.cos(bearing), distance * math.sin(bearing), bearing + rng.uniform(-0.6, 0.6))
        features = features_at(config.leds.points, pose, config.camera.mount) + rng.normal(0.0, 2e-4, (4, 2))
        candidates, rows = shuffled(features, clutter(20, rng), rng)
        found = identifier.identify(candidates, np.full(24, 500.0), False)
        if isinstance(found, Match):
            assert list(found.spot_of_led) == rows
            right += 1
    assert right >= 115


def test_what_is_enough_alone_is_not_enough_among_many(config: Config) -> None:
    rolled = np.array([[4.2, 0.36, 0.12, 0.0, 0.021]])  # 1.7 standard deviations of the mounting's tilt
    features = project(model(config), rolled)[0][0]
    height = features[:, 1].mean()
    others = np.column_stack([np.linspace(-1.4, 1.4, 32), np.full(32, height)])
    identifier = Identifier(model(config), Limits())
    alone = identifier.identify(features, np.full(4, 500.0), False)
    assert isinstance(alone, Match)
    assert 1.5 < alone.chi2 < 4.0
    # too bright to be taken for LEDs themselves, yet so many chances of coincidence
    mass = np.concatenate([np.full(4, 500.0), np.full(32, 1e6)])
    assert identifier.identify(np.vstack([features, others]), mass, False) == "no_match"


def test_mirrored_array_is_not_accepted(config: Config) -> None:
    mirrored = config.leds.points * [1.0, -1.0, 1.0]
    identifier = Identifier(model(config), Limits())
    for pose in POSES:
        features = features_at(mirrored, pose, config.camera.mount)
        assert not isinstance(identifier.identify(features, np.full(4, 500.0), False), Match)


def test_two_arrays_are_ambiguous(config: Config) -> None:
    features = np.vstack(
        [features_at(config.leds.points, p, config.camera.mount) for p in (POSES[1], Pose2(5, -1, 0))]
    )
    assert Identifier(model(config), Limits()).identify(features, np.full(8, 500.0), False) == "ambiguous"


@pytest.mark.parametrize("hidden", range(4))
def test_three_leds_alone_are_found_if_allowed(config: Config, hidden: int) -> None:
    features = features_at(config.leds.points, Pose2(4.0, 0.4, 0.1), config.camera.mount)
    three = np.delete(features, hidden, axis=0)
    identifier = Identifier(model(config), Limits())
    assert identifier.identify(three, np.full(3, 500.0), False) == "few_spots"
    found = identifier.identify(three, np.full(3, 500.0), True)
    assert isinstance(found, Match)
    assert found.spot_of_led == tuple(np.insert(np.arange(3), hidden, -1))


@pytest.mark.parametrize(
    ("distance_m", "bearing_rad", "turned_rad"), [(1.8, 0.0, 0.3), (2.4, 0.0, 0.28), (3.5, 0.2, 0.3), (4.4, 0.0, 0.3)]
)
def test_three_leds_that_a_mirror_image_explains_are_not_sure(
    config: Config, distance_m: float, bearing_rad: float, turned_rad: float
) -> None:
    """Without the LED that makes the array most asymmetric, a mirror image fits as an array turned away."""
    place = distance_m * math.cos(bearing_rad), distance_m * math.sin(bearing_rad)
    identifier = Identifier(model(config), Limits())
    for points, turn in ((config.leds.points * [1.0, -1.0, 1.0], turned_rad), (config.leds.points, -turned_rad)):
        three = features_at(points, Pose2(*place, bearing_rad + turn), config.camera.mount)[:3]
        assert identifier.identify(three, np.full(3, 500.0), True) == "ambiguous"


def test_three_leds_where_the_array_was_left_need_no_fourth(config: Config) -> None:
    pose = Pose2(3.0, 0.0, -0.3)
    three = features_at(config.leds.points, pose, config.camera.mount)[:3]
    found = Identifier(model(config), Limits()).identify(
        three, np.full(3, 500.0), True, lambda states, _: np.abs(states[:, 2] - pose.theta_rad) < 0.2
    )
    assert isinstance(found, Match)
    assert found.spot_of_led == (0, 1, 2, -1)


def test_spots_of_quite_another_brightness_are_not_of_one_array(config: Config) -> None:
    features = features_at(config.leds.points, POSES[1], config.camera.mount)
    mass = np.array([500.0, 10.0, 500.0, 10.0])
    assert not isinstance(Identifier(model(config), Limits()).identify(features, mass, False), Match)


def test_nothing_in_sight(config: Config) -> None:
    assert Identifier(model(config), Limits()).identify(np.zeros((0, 2)), np.zeros(0), True) == "few_spots"


@pytest.mark.parametrize("layout", [4353, 7578, 8794])
def test_coincidence_among_forty_spots_is_refused(config: Config, layout: int) -> None:
    """Layouts without the array in which some four spots fit as well as would do among ten."""
    rng = np.random.default_rng(layout)
    spots = np.column_stack([rng.uniform(-1.2, 1.2, 40), rng.uniform(-0.4, -0.02, 40)])
    few = Identifier(model(config), Limits(most_for_loose=40)).identify(spots, np.full(40, 500.0), False)
    assert isinstance(few, Match)
    assert Identifier(model(config), Limits()).identify(spots, np.full(40, 500.0), False) == "no_match"
