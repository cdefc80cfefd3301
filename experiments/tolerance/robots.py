"""Robots that are not as configured, what each way to learn of it makes of them, and one docking of each."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from common.config import Config, replaced
from common.geometry import Pose2, pose_from_paper_start
from experiments.tolerance.docking import ApproachEnd, dock
from experiments.tolerance.drives import recorded_drives
from experiments.tolerance.world import TrueRobot
from follower.calibration.bundle import calibrate_robot
from follower.estimator.lens import Lens
from follower.model.taught_geometry import TaughtGeometry, corrected
from sim.truth import Tolerances, Truth
from sim.world_config import world_config

# camera, lens, LEDs and wheels as well as they are measured with tape, protractor and a calibrated board
CLASSES: Final[Mapping[str, Tolerances]] = {
    "exact": Tolerances(),
    "camera_position": Tolerances(camera_m=0.005),
    "camera_attitude": Tolerances(camera_deg=1.0),
    "focal_length": Tolerances(focal=0.01),
    "leds": Tolerances(leds_m=0.002),
    "leader_stand": Tolerances(leader_tilt_deg=0.5, leader_height_m=0.005),
    "wheels": Tolerances(wheel_radius=0.02, track=0.03),
    "latency": Tolerances(latency_ms=40.0),
    "all": Tolerances(
        camera_m=0.005,
        camera_deg=1.0,
        focal=0.01,
        leds_m=0.002,
        wheel_radius=0.02,
        track=0.03,
        latency_ms=40.0,
    ),
}
_START_M, _START_SIDE_M, _START_DEG = (4.0, 6.5), 1.2, 20.0


@dataclass(frozen=True)
class RobotJob:
    """One docking.

    Attributes:
        config_text: the robots as configured, as JSON.
        method: one of :data:`METHODS`.
        truth: in what this robot differs.
        trolley: K.
        taught: dockings that were taught before, at their exact goals.
        seed, number: of the run; start and noise depend on them alone, so methods meet the same.
    """

    config_text: str
    method: str
    truth: Truth
    trolley: int = 1
    taught: tuple[int, ...] = (1,)
    seed: int = 1
    number: int = 0


def _as_configured(config: Config, world: TrueRobot, job: RobotJob) -> None:
    """Nothing is learned."""


def _as_taught(config: Config, world: TrueRobot, job: RobotJob) -> TaughtGeometry:
    """The robot stands at the goals of the dockings that are taught: what its camera sees there, averaged."""
    lens = Lens(config.camera)
    goals = {trolley: config.docking.goal(trolley) for trolley in job.taught}
    return corrected(config, {k: lens.to_normalised(world.seen_from(goal)) for k, goal in goals.items()})


def _as_calibrated(config: Config, world: TrueRobot, job: RobotJob) -> TaughtGeometry:  # noqa: ARG001 - as the others
    """Camera and LEDs from five recorded drives of this robot; its wheels stay as configured."""
    found = calibrate_robot(recorded_drives(config, job.truth, [job.seed, job.number, 5]), config)
    learned = replaced(config, camera=found.config.camera, leds=found.config.leds)
    return TaughtGeometry(learned, {job.trolley: config.docking.goal(job.trolley)}, 0.0, 0.0)


METHODS: Final[Mapping[str, Callable[[Config, TrueRobot, RobotJob], TaughtGeometry | None]]] = {
    "geometry": _as_configured,
    "taught": _as_taught,
    "calibrated": _as_calibrated,
}


def start_of(job: RobotJob) -> Pose2:
    """Pose of {F} in {L} at the start: the same for all methods and classes of one number."""
    random = np.random.default_rng([job.seed, job.number, 1])
    nested_m = Config.model_validate_json(job.config_text).docking.trolley_pitch_m * (job.trolley - 1)
    behind = random.uniform(*_START_M) + nested_m
    side, heading = random.uniform(-_START_SIDE_M, _START_SIDE_M), random.uniform(-_START_DEG, _START_DEG)
    return pose_from_paper_start(behind, side, math.radians(heading))


def dock_job(job: RobotJob) -> ApproachEnd:
    """Learn, then dock once."""
    config = Config.model_validate_json(job.config_text)
    world = TrueRobot(
        config, world_config(config, "tolerance"), job.truth, start_of(job), [job.seed, job.number, job.trolley]
    )
    return dock(config, METHODS[job.method](config, world, job), job.trolley, world)
