"""What one error costs, to first order, against other ways to the same number."""

from __future__ import annotations

import numpy as np
import pytest

from common.config import Config
from common.docking_errors import docked_error
from common.geometry import Pose2
from experiments.tolerance.robots import dock_job
from experiments.tolerance.sensitivity import (
    COLUMNS,
    UnitError,
    docked,
    jobs_of,
    linearised,
    signed,
    table,
    unit_errors,
)
from experiments.tolerance.world import TrueRobot
from follower.estimator.lens import Lens
from follower.estimator.pipeline import TILT_SIGMA_RAD
from follower.estimator.planar_fit import FitModel
from follower.estimator.single_fit import fit_one
from sim.world_config import world_config


def ends_at(config: Config, error: UnitError) -> dict[str, float]:
    """Where the pose fitted to the true image is the goal: found by steps, without a linearised model."""
    goal = config.docking.goal(1)
    robot = TrueRobot(config, world_config(config, "test"), error.truth, goal.inverse(), [0])
    model = FitModel(
        config.leds.points,
        config.camera.mount,
        config.estimator.pixel_sigma_px / config.camera.lens.fx_px,
        TILT_SIGMA_RAD,
    )
    stands = goal.as_array()
    for _ in range(6):
        image = Lens(config.camera).to_normalised(robot.seen_from(Pose2(*stands.tolist())))
        fitted = fit_one(model, image, np.array([*goal.as_array(), 0.0, 0.0]), 20)
        assert fitted is not None
        stands = stands - (fitted.pose.as_array() - goal.as_array())
    return signed(docked_error(Pose2(*stands.tolist()).inverse(), goal))


def test_linearised_errors_are_where_the_fit_ends(config: Config) -> None:
    for error in unit_errors(config):
        exact, linear = ends_at(config, error), linearised(config, error)
        for name in COLUMNS:
            assert linear[name] * error.units == pytest.approx(exact[name], rel=0.05, abs=0.01), (error.name, name)


def test_a_camera_moved_sideways_moves_the_robot_the_other_way(config: Config) -> None:
    error = next(error for error in unit_errors(config) if error.name == "camera y 1 mm")
    expected = linearised(config, error)
    ends = [dock_job(job) for job in jobs_of(config.model_dump_json(), error, seed=1)]
    assert [end.cause for end in ends] == ["", ""]
    found = docked(error, [signed(end.error) for end in ends])
    assert expected["e_y_cm"] == pytest.approx(-0.08, abs=0.04)
    assert found["e_y_cm"] == pytest.approx(expected["e_y_cm"], abs=0.03)


def test_the_table_has_a_dash_where_nothing_docked() -> None:
    line = table([("LED 0 X 1 mm", dict.fromkeys(COLUMNS, 0.5), None)]).splitlines()[-1]
    assert line == "| LED 0 X 1 mm | +0.500 | – | +0.500 | – | +0.500 | – |"
