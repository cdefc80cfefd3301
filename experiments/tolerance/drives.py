"""Recorded approaches of a robot that is not as configured, and what it is calibrated to by them."""

from __future__ import annotations

import math

import numpy as np

from common.config import Config
from common.geometry import Pose2, pose_from_paper_start
from common.messages import DockingState
from experiments.tolerance.docking import dock
from experiments.tolerance.world import TrueRobot
from follower.calibration.drive import Drive
from sim.truth import Truth
from sim.world_config import world_config

_START_M, _SIDE_M, _HEADING_DEG = (4.0, 5.5), 1.0, 18.0


def recorded_drives(config: Config, truth: Truth, seed: list[int], count: int = 5) -> list[Drive]:
    """Approaches to trolley 1 by the configured geometry, from alternate sides.

    Args:
        config: as the robots have it.
        truth: in what the robot differs.
        seed: of starts and noise.
        count: drives.
    """
    random = np.random.default_rng([*seed, 2])
    drives = []
    for number in range(count):
        side = (-1) ** number * random.uniform(0.4, 1.0) * _SIDE_M
        heading = random.uniform(-_HEADING_DEG, _HEADING_DEG)
        start = pose_from_paper_start(random.uniform(*_START_M), side, math.radians(heading))
        drives.append(_recorded(config, truth, start, [*seed, number]))
    return drives


def _recorded(config: Config, truth: Truth, start: Pose2, seed: list[int]) -> Drive:
    world = TrueRobot(config, world_config(config, "tolerance"), truth, start, seed)
    wheels: list[tuple[int, float, float]] = []
    frames: list[tuple[int, DockingState]] = []

    def watch(now_ns: int, state: DockingState, true: TrueRobot) -> None:
        wheels.append((now_ns, *true.wheel_angle_rad))
        if state.valid and any(point is not None for point in state.features):
            frames.append((now_ns, state))

    dock(config, None, 1, world, watch)
    return Drive(
        frames_ns=np.array([time_ns for time_ns, _ in frames]),
        features=np.array([[point or (math.nan, math.nan) for point in state.features] for _, state in frames]),
        poses=np.array([(state.x_m, state.y_m, state.theta_rad) for _, state in frames]),
        wheels_ns=np.array([row[0] for row in wheels]),
        wheel_angle_rad=np.array([row[1:] for row in wheels]),
    )
