"""A doubted image is believed again once it follows a turn on the spot, and given up when it stands through one."""

from __future__ import annotations

from dataclasses import replace

import pytest

from common.config import Config
from common.geometry import Pose2, features_at, move_relative
from common.messages import DockingState
from follower.supervisor.image_trust import ImageTrust
from tests.rigs.supervisor_rig import docking_state

BEFORE = Pose2(4.0, 0.3, 0.05)


def seen(config: Config, turned_rad: float, share: float = 1.0, leds: int = 4) -> DockingState:
    """What the camera sees after a turn on the spot, if the image follows by so much of it."""
    pose = move_relative(BEFORE, 0.0, share * turned_rad, 1.0)
    features = features_at(config.leds.points, pose, config.camera.mount)
    shown = tuple((float(a), float(b)) if led < leds else None for led, (a, b) in enumerate(features))
    return replace(docking_state(config, pose), features=shown)


def doubted(config: Config, heading_rad: float = 1.0) -> ImageTrust:
    """The image has not followed; the robot stands since, seen once."""
    trust = ImageTrust(config)
    trust.step(replace(docking_state(config, BEFORE, valid=False), cause="not_following"), heading_rad)
    trust.step(seen(config, 0.0), heading_rad)
    return trust


def test_an_image_is_believed_until_it_does_not_follow(config: Config) -> None:
    trust = ImageTrust(config)
    assert (trust.doubted, trust.stands) == (False, False)
    for turned_rad in (0.0, 0.1):
        trust.step(seen(config, turned_rad, share=0.0), turned_rad)
    trust.step(None, 0.2)
    assert (trust.doubted, trust.stands) == (False, False)
    assert doubted(config).doubted


@pytest.mark.parametrize("turned_rad", [0.02, -0.02])
@pytest.mark.parametrize(
    ("share", "leds", "believed"), [(1.0, 4, True), (0.5, 2, True), (0.3, 4, False), (1.0, 1, False)]
)
def test_it_is_believed_again_if_two_leds_follow_a_turn(
    config: Config, turned_rad: float, share: float, leds: int, believed: bool
) -> None:
    trust = doubted(config)
    trust.step(seen(config, turned_rad, share, leds), 1.0 + turned_rad)
    assert (trust.doubted, trust.stands) == (not believed, False)


def test_a_turn_that_is_too_small_decides_nothing(config: Config) -> None:
    trust = doubted(config)
    trust.step(seen(config, 0.011), 1.011)
    assert (trust.doubted, trust.stands) == (True, False)


@pytest.mark.parametrize("turned_rad", [0.031, -0.031])
def test_an_image_that_stands_through_a_turn_is_given_up(config: Config, turned_rad: float) -> None:
    trust = doubted(config)
    trust.step(seen(config, turned_rad, share=0.0), 1.0 + turned_rad)
    assert (trust.doubted, trust.stands) == (True, True)


def test_the_turn_counts_from_the_first_image_after_the_doubt(config: Config) -> None:
    trust = ImageTrust(config)
    trust.step(replace(docking_state(config, BEFORE, valid=False), cause="not_following"), 0.0)
    trust.step(seen(config, 0.0, leds=1), 0.0)
    trust.step(replace(seen(config, 0.0), valid=False), 0.0)
    trust.step(seen(config, 0.0), 0.5)
    trust.step(seen(config, 0.02), 0.52)
    assert not trust.doubted


def test_a_new_doubt_starts_again(config: Config) -> None:
    trust = doubted(config)
    trust.step(seen(config, 0.05, share=0.0), 1.05)
    assert trust.stands
    trust.step(replace(docking_state(config, BEFORE, valid=False), cause="not_following"), 1.05)
    assert (trust.doubted, trust.stands) == (True, False)


def test_a_state_of_another_array_changes_nothing(config: Config) -> None:
    trust = doubted(config)
    trust.step(replace(seen(config, 0.05), features=((0.0, 0.0),) * 3), 1.05)
    assert (trust.doubted, trust.stands) == (True, False)
