"""The world differs from the configuration as ``[world.truth]`` says, and the robots' files do not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from common.config import Config, load_config
from common.errors import ConfigError
from common.geometry import Pose2
from sim.can.nodes import FollowerBus
from sim.optics.image import Optics, View
from sim.truth import Tolerances, Truth, true_robots
from sim.world_config import world_config

ALL = Tolerances(
    camera_m=0.005,
    camera_deg=1.0,
    focal=0.01,
    centre_px=2.0,
    distortion=0.005,
    leds_m=0.002,
    leader_tilt_deg=0.5,
    leader_height_m=0.005,
    wheel_radius=0.02,
    track=0.03,
    gear=0.01,
    encoder=0.001,
    latency_ms=40.0,
)


def pixels(config: Config) -> np.ndarray:
    """Of the LEDs from two metres, where nothing is symmetric."""
    optics = Optics(config.camera, config.leds, seed=1)
    return optics.led_truth(View(1, Pose2(2.0, 0.2, 0.1), (1.0,) * 4))[0]


def test_without_an_error_the_world_has_the_configuration_itself(config: Config) -> None:
    assert true_robots(config, Truth()) is config
    assert true_robots(config, Truth(seed=7)) is config
    assert true_robots(config, Truth(latency_ms=20.0)) is config  # light alone is late


@pytest.mark.parametrize(
    ("truth", "moved_px"),
    [
        # 2 m less the camera's place, and the array's depth: about 1.75 m to the LEDs, 369.5 px
        (Truth(camera_m=(0.0, 0.01, 0.0)), (2.1, 0.0)),
        (Truth(camera_tilt_deg=(1.0, 0.0, 0.0)), (0.0, 6.5)),  # looking up lowers the image
        (Truth(camera_tilt_deg=(0.0, 0.0, 1.0)), (6.5, 0.0)),  # to the left: the image moves right
        (Truth(leader_height_m=0.01), (0.0, -2.1)),
        (Truth(centre_px=(3.0, -2.0)), (3.0, -2.0)),
    ],
)
def test_an_error_moves_the_image_as_it_should(config: Config, truth: Truth, moved_px: tuple[float, float]) -> None:
    moved = (pixels(true_robots(config, truth)) - pixels(config)).mean(axis=0)
    assert moved == pytest.approx(moved_px, abs=0.6)


def test_focal_length_and_distortion_scale_about_the_centre(config: Config) -> None:
    centre = [config.camera.lens.cx_px, config.camera.lens.cy_px]
    wide = (pixels(true_robots(config, Truth(focal=0.01))) - centre) / (pixels(config) - centre)
    assert wide == pytest.approx(1.01)
    bent = pixels(true_robots(config, Truth(distortion=0.02))) - centre
    ideal = (pixels(config) - centre) / config.camera.lens.fx_px
    assert bent / (pixels(config) - centre) == pytest.approx(
        np.repeat(1.0 + 0.02 * (ideal**2).sum(axis=1, keepdims=True), 2, axis=1)
    )


def test_each_led_and_the_leader_s_tilt_move_points(config: Config) -> None:
    errors = ((0.001, 0.0, 0.0), (0.0, 0.002, 0.0), (0.0, 0.0, 0.003), (0.0, 0.0, 0.0))
    moved = true_robots(config, Truth(leds_m=errors)).leds.points - config.leds.points
    assert moved == pytest.approx(np.array(errors))
    tilted = true_robots(config, Truth(leader_tilt_deg=(1.0, 0.0))).leds.points - config.leds.points
    assert tilted[:, 0] == pytest.approx(-np.radians(1.0) * config.leds.points[:, 2], rel=0.02)


@pytest.mark.parametrize(
    ("truth", "faster"),
    [
        (Truth(wheel_radius=(0.02, 0.0)), (1.02, 1.0)),
        (Truth(gear=(0.0, 0.02)), (1.0, 1 / 1.02)),
        (Truth(encoder=(0.01, 0.01)), (1 / 1.01, 1 / 1.01)),
    ],
)
def test_a_wheel_rolls_farther_for_its_counts(
    config: Config, config_path: Path, truth: Truth, faster: tuple[float, float]
) -> None:
    believed = FollowerBus.build(config.follower_can, config_path)
    true = FollowerBus.build(true_robots(config, truth).follower_can, config_path)
    for bus in (believed, true):
        for wheel in (bus.left_wheel, bus.right_wheel):
            wheel.set_measured(10.0, 0.0, 0.0)
            wheel.sampled()
    counted = [
        float(ours.values[0x6064, 0]) / float(theirs.values[0x6064, 0])
        for ours, theirs in ((believed.left_wheel, true.left_wheel), (believed.right_wheel, true.right_wheel))
    ]
    assert counted == pytest.approx(faster, rel=1e-5)


def test_tolerances_are_drawn_for_the_seed_each_kind_apart() -> None:
    drawn = Truth(seed=3, tolerances=ALL).drawn(4)
    assert drawn == Truth(seed=3, tolerances=ALL).drawn(4)
    assert drawn.tolerances == Tolerances()
    camera = Truth(seed=3, tolerances=Tolerances(camera_m=0.005)).drawn(4)
    assert camera.camera_m == drawn.camera_m  # whatever else is drawn
    assert camera.camera_tilt_deg == (0.0, 0.0, 0.0)
    assert camera.leds_m == ((0.0, 0.0, 0.0),) * 4
    assert Truth(seed=4, tolerances=ALL).drawn(4).camera_m != drawn.camera_m


def test_draws_fill_their_tolerance_and_add_to_what_is_set() -> None:
    many = [Truth(seed=seed, focal=0.05, tolerances=ALL).drawn(4) for seed in range(300)]
    focal = [truth.focal for truth in many]
    assert 0.04 <= min(focal) < 0.041
    assert 0.059 < max(focal) <= 0.06
    leds = np.array([truth.leds_m for truth in many])
    assert 0.0019 < np.abs(leds).max() <= 0.002
    assert 0.0 <= min(truth.latency_ms for truth in many) < 1.0
    assert 39.0 < max(truth.latency_ms for truth in many) <= 40.0


def test_it_is_a_table_of_the_file(config_path: Path) -> None:
    config = load_config(config_path, ["world.truth.camera_m=[0.0,0.005,0.0]", "world.truth.tolerances.focal=0.01"])
    truth = world_config(config, "file").truth
    assert truth.camera_m == (0.0, 0.005, 0.0)
    assert truth.tolerances.focal == 0.01


@pytest.mark.parametrize(
    ("override", "named"),
    [
        ("world.truth.leds_m=[[0.0,0.0,0.001]]", "leds_m: 1 errors for 4 LEDs"),
        ("world.truth.camera_mm=1.0", "camera_mm"),
        ("world.truth.focal=2.0", "focal"),
    ],
)
def test_a_mistake_is_one_line_that_names_the_key(config_path: Path, override: str, named: str) -> None:
    config = load_config(config_path, [override])
    with pytest.raises(ConfigError, match=named):
        world_config(config, "file")
