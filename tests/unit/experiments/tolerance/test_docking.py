"""A docking from spots, by the robot's own code."""

from __future__ import annotations

import pytest

from common.config import Config
from experiments.tolerance.robots import RobotJob, dock_job
from sim.truth import Truth


def job(config: Config, truth: Truth, method: str = "geometry") -> RobotJob:
    return RobotJob(config.model_dump_json(), method, truth)


def test_an_exact_robot_arrives_and_the_same_way_again(config: Config) -> None:
    end = dock_job(job(config, Truth()))
    assert end.cause == ""
    assert abs(end.error.e_y_m) < 0.002
    assert abs(end.error.e_theta_deg) < 0.4
    assert 10.0 < end.seconds < 40.0
    assert dock_job(job(config, Truth())) == end


@pytest.mark.parametrize("method", ["geometry", "taught"])
def test_a_turned_camera_costs_millimetres_unless_taught(config: Config, method: str) -> None:
    end = dock_job(job(config, Truth(camera_tilt_deg=(1.0, 0.0, 1.0)), method))
    assert end.cause == ""
    if method == "taught":
        assert abs(end.error.e_y_m) < 0.002
        assert abs(end.error.e_theta_deg) < 0.4
    else:
        assert abs(end.error.e_theta_deg) > 0.6


def test_an_array_that_fits_no_pose_ends_with_a_cause(config: Config) -> None:
    moved = ((0.0, 0.0, 0.3), (0.0, -0.3, 0.0), (0.0, 0.3, 0.0), (0.0, 0.0, -0.3))
    end = dock_job(job(config, Truth(leds_m=tuple((0.0, y / 2, z / 2) for _, y, z in moved))))
    assert end.cause.startswith("leds_lost")
    assert end.error.e_x_m > 1.0
