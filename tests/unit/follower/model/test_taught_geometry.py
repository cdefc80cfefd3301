"""What taught images make of a geometry that is a little wrong, against the world's own optics."""

from __future__ import annotations

import math

import numpy as np
import pytest

from common.config import Config
from common.docking_errors import docked_error
from common.geometry import Array, Pose2
from follower.estimator.lens import Lens
from follower.estimator.planar_fit import FitModel
from follower.estimator.single_fit import fit_one
from follower.model.taught_geometry import corrected
from sim.optics.image import Optics, View
from sim.truth import Tolerances, Truth, true_robots

WRONG = Tolerances(camera_m=0.005, camera_deg=1.0, focal=0.01, leds_m=0.002)


def pixels(true: Config, pose: Pose2) -> Array:
    """Of the LEDs in the true robot's image, (n, 2)."""
    return Optics(true.camera, true.leds, seed=1).led_truth(View(1, pose, (1.0,) * len(true.leds.points)))[0]


def believed(robots: Config, image: Array, start: Pose2) -> Pose2:
    """Pose that perception makes of an image."""
    model = FitModel(robots.leds.points, robots.camera.mount, 0.3 / robots.camera.lens.fx_px, math.radians(0.7))
    found = fit_one(model, Lens(robots.camera).to_normalised(image), np.array([*start.as_array(), 0.0, 0.0]), 20)
    assert found is not None
    return found.pose


def errors_cm(robots: Config, truth: Truth, taught: tuple[int, ...], trolley: int) -> float:
    """Lateral error of a docking that ends where the image says so, to first order."""
    true, lens = true_robots(robots, truth), Lens(robots.camera)
    images = {k: lens.to_normalised(pixels(true, robots.docking.goal(k))) for k in taught}
    found = corrected(robots, images)
    goal = robots.docking.goal(trolley)
    seen = believed(found.config, pixels(true, goal), goal)
    error = docked_error(seen.inverse(), found.goals.get(trolley, goal))
    return 100 * abs(error.e_y_m)


@pytest.mark.parametrize("seed", range(6))
def test_at_a_taught_goal_the_pose_is_the_taught_one(config: Config, seed: int) -> None:
    truth = Truth(seed=seed, tolerances=WRONG)
    assert errors_cm(config, truth, (1,), 1) < 0.02
    assert errors_cm(config, truth, (1, 4), 4) < 0.06
    untaught = believed(config, pixels(true_robots(config, truth), config.docking.goal(1)), config.docking.goal(1))
    assert 100 * abs(docked_error(untaught.inverse(), config.docking.goal(1)).e_y_m) > 0.02


def test_a_second_image_helps_the_untaught_dockings(config: Config) -> None:
    truths = [Truth(seed=seed, tolerances=WRONG) for seed in range(12)]
    first = np.mean([errors_cm(config, truth, (1,), 8) for truth in truths])
    both = np.mean([errors_cm(config, truth, (1, 4), 8) for truth in truths])
    assert both < 0.5 * first
    assert both < 0.3


def test_one_degree_of_pitch_is_taken_out(config: Config) -> None:
    truth = Truth(camera_tilt_deg=(1.0, 0.0, 0.0))
    true, goal = true_robots(config, truth), config.docking.goal(1)
    image = pixels(true, goal)
    found = corrected(config, {1: Lens(config.camera).to_normalised(image)})
    assert found.config.camera.mount_tilt_deg[0] == pytest.approx(1.0, abs=0.15)
    assert found.unexplained_px < 0.02
    assert found.sigmas < 2.5


def test_an_image_as_configured_corrects_nothing(config: Config) -> None:
    goal = config.docking.goal(1)
    found = corrected(config, {1: Lens(config.camera).to_normalised(pixels(config, goal))})
    assert found.config.leds.points == pytest.approx(config.leds.points, abs=1e-9)
    assert found.config.camera.mount == pytest.approx(config.camera.mount, abs=1e-9)
    assert found.goals[1].as_array() == pytest.approx(goal.as_array(), abs=1e-9)


@pytest.mark.parametrize("model", ["fisheye", "rational"])
def test_it_corrects_through_any_lens(config: Config, model: str) -> None:
    count = {"fisheye": 4, "rational": 8}[model]
    lens = config.camera.lens.model_copy(update={"model": model, "coefficients": (0.02, *(0.0,) * (count - 1))})
    robots = config.model_copy(update={"camera": config.camera.model_copy(update={"lens": lens})})
    assert errors_cm(robots, Truth(seed=2, tolerances=WRONG), (1,), 1) < 0.02
