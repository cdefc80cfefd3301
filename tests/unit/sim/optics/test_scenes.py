"""Hard scenes: what the light does, and that perception neither loses the array there nor takes another for it."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest

from common.config import Config
from common.geometry import Pose2
from experiments.perception.approach import Look, approach
from experiments.perception.scene_counts import scene_metrics
from follower.estimator.state import StateEstimator
from sim.optics.image import Optics, View
from sim.optics.scenes import CLEAN, SCENES, Lamp, LedFault, Scene, SecondArray, Walker, Wall, named_scene

HERE = View(3, Pose2(6.0, 0.0, 0.0), (1.0, 1.0, 1.0, 1.0))


@pytest.fixture(scope="module")
def optics(config: Config) -> Optics:
    return Optics(config.camera, config.leds, seed=5)


def looks(config: Config, optics: Optics, scene: Scene, seed: int, frames: int) -> list[Look]:
    return list(islice(approach(config, optics, StateEstimator(config), scene, seed), frames))


def test_an_unknown_scene_is_named() -> None:
    with pytest.raises(ValueError, match=r"no scene 'fog'; there are: clean, dark_outdoor"):
        named_scene("fog")


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_is_repeatable_and_its_seed_matters(name: str) -> None:
    assert named_scene(name, 4) == named_scene(name, 4)
    assert name == "clean" or any(named_scene(name, seed) != named_scene(name, 4) for seed in range(5, 9))


def test_floor_mirrors_below_and_wall_beside(optics: Optics) -> None:
    direct = optics.specks(HERE)
    floor = optics.specks(replace(HERE, scene=Scene(floor_reflectance=0.5)))
    wall = optics.specks(replace(HERE, scene=Scene(walls=(Wall(np.pi / 2, 2.0, 0.5),))))
    assert len(floor) == len(wall) == 2 * len(direct)
    assert all(image.v_px > 512 for image in floor[4:])
    # the wall is to the left: the images lie left of the array, mirrored, farther away and dimmer
    assert max(image.u_px for image in wall[4:]) < min(led.u_px for led in direct)
    assert all(image.peak < 0.5 * led.peak for image, led in zip(wall[4:], direct, strict=True))


def test_a_walker_hides_what_is_behind_him(optics: Optics) -> None:
    scene = Scene(walkers=(Walker((-1.0, -1.0), (0.0, 1.0), 0.0),))
    assert len(optics.specks(replace(HERE, scene=scene, time_ns=0))) == 4
    assert len(optics.specks(replace(HERE, scene=scene, time_ns=1_000_000_000))) < 4


def test_lamps_flicker_and_leds_fail(optics: Optics) -> None:
    lamp = Scene(lamps=(Lamp((4.0, 1.0, 2.0), 20_000.0, flicker=1.0),))
    peaks = [optics.specks(replace(HERE, scene=lamp, time_ns=ns)) for ns in (5_000_000, 10_000_000)]
    assert len(peaks[0]) == 5
    assert len(peaks[1]) == 4
    blinking = Scene(faults=(LedFault(1, 0.0, 0.5, blink_hz=2.0),))
    seen = [len(optics.specks(replace(HERE, scene=blinking, time_ns=round(1e9 * t)))) for t in (0.1, 0.6, 0.8, 1.1)]
    assert seen == [4, 3, 4, 3]


def test_sun_and_ambient_brighten_the_frame(config: Config, optics: Optics) -> None:
    scene = named_scene("glass_hall", 1)
    lit = np.zeros((config.camera.height_px, config.camera.width_px), np.uint8)
    plain = lit.copy()
    optics.render(lit, replace(HERE, scene=scene))
    optics.render(plain, HERE)
    assert np.median(lit) >= np.median(plain) + 10
    assert (lit == 190).sum() > 200


@pytest.mark.parametrize("name", ["parking_lot", "glass_hall", "clutter40"])
def test_no_loss_and_no_wrong_led(config: Config, optics: Optics, name: str) -> None:
    counted = scene_metrics([looks(config, optics, named_scene(name, 2), 2, 240)])
    assert counted["never_locked"] == 0
    assert counted["lock_max_s"] < 1.0
    assert counted["losses"] == counted["wrong_led_frames"] == counted["false_locks"] == 0


def test_an_occlusion_is_flagged_and_over_as_soon_as_the_leds_are_back(config: Config, optics: Optics) -> None:
    scene = Scene(walkers=(Walker((-1.0, -1.6), (0.0, 1.4), 0.8),))
    counted = scene_metrics([looks(config, optics, scene, 1, 240)])
    assert counted["losses"] >= 1
    assert counted["losses_leds_visible"] == counted["late_flags"] == counted["wrong_led_frames"] == 0
    assert counted["relock_max_s"] <= 0.5


def test_one_led_dead_from_the_start_still_locks(config: Config, optics: Optics) -> None:
    seen = looks(config, optics, Scene(faults=(LedFault(2, 0.0),)), 3, 90)
    assert seen[-1].detection.valid
    assert seen[-1].detection.leds_seen == 3
    assert scene_metrics([seen])["wrong_led_frames"] == 0


def test_another_leaders_array_is_never_taken_for_ours(config: Config, optics: Optics) -> None:
    beside = SecondArray(Pose2(0.5, 2.0, 0.1))
    both = looks(config, optics, Scene(others=(beside,)), 0, 60)
    assert {look.detection.cause for look in both} == {"ambiguous"}
    ours_has_a_dark_led = looks(config, optics, Scene(others=(beside,), faults=(LedFault(1, 0.0),)), 0, 60)
    assert {look.detection.cause for look in ours_has_a_dark_led} == {"ambiguous"}
    later = looks(config, optics, Scene(others=(replace(beside, start_s=0.3),)), 0, 90)
    assert later[-1].detection.valid
    assert scene_metrics([later])["wrong_led_frames"] == 0


@pytest.mark.parametrize("seed", [0, 1])
def test_another_leader_is_not_taken_while_ours_is_hidden(config: Config, optics: Optics, seed: int) -> None:
    beside = SecondArray(Pose2(0.5, 2.0, 0.1), start_s=0.6)
    scene = Scene(others=(beside,), walkers=(Walker((-1.0, -1.6), (0.0, 1.2), 0.7),))
    counted = scene_metrics([looks(config, optics, scene, seed, 240)])
    assert counted["losses"] >= 1
    assert counted["false_locks"] == counted["wrong_led_frames"] == 0
    assert counted["relock_max_s"] <= 0.5


def test_another_leader_is_not_taken_after_ours_went_dark_for_good(config: Config, optics: Optics) -> None:
    dark = tuple(LedFault(led, 0.0, 0.4) for led in range(4))
    scene = Scene(faults=dark, others=(SecondArray(Pose2(0.5, 2.0, 0.1), start_s=0.4),))
    seen = looks(config, optics, scene, 0, 150)
    assert seen[20].detection.valid
    assert not any(look.detection.valid for look in seen[30:])
    assert "ambiguous" in {look.detection.cause for look in seen[30:]}


def test_a_mirrored_array_alone_is_never_accepted(config: Config, optics: Optics) -> None:
    only_mirror = Scene(leds_lit=False, others=(SecondArray(Pose2(0.0, 0.0, 0.0), mirrored=True),))
    assert not any(look.detection.valid for look in looks(config, optics, only_mirror, 1, 90))


def test_forty_lamps_without_the_array_give_no_lock(config: Config, optics: Optics) -> None:
    dark = replace(named_scene("clutter40", 1), leds_lit=False)
    assert not any(look.detection.valid for look in looks(config, optics, dark, 1, 90))


def test_wrong_exposure_is_survived_or_named(config: Config, optics: Optics) -> None:
    bright = looks(config, optics, Scene(exposure_factor=6.0), 1, 60)
    assert bright[-1].detection.valid
    dim = looks(config, optics, Scene(exposure_factor=0.07), 1, 60)
    assert [look.detection.cause for look in dim].count("underexposed") > 50
    glaring = looks(config, optics, Scene(ambient_grey=250.0), 1, 20)
    assert {look.detection.cause for look in glaring} <= {"overexposed", "noisy"}


def test_leds_that_are_off_are_no_matter_of_exposure(config: Config, optics: Optics) -> None:
    assert {look.detection.cause for look in looks(config, optics, Scene(leds_lit=False), 1, 20)} == {"few_leds"}


def test_clean_is_the_default() -> None:
    assert named_scene("clean") == CLEAN == HERE.scene
