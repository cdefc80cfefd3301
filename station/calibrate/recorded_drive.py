"""The approach in a recording, as the calibration of a robot takes it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from common.channels import DOCKING_STATE, DRIVES, MISSION
from common.config import Config
from common.errors import ConfigError
from common.messages import DockingState
from common.recording.recording import Recording
from follower.calibration.drive import Drive
from follower.model.taught import geometry_tag

FEWEST_LEDS = 3
_APPROACH = ("acquire", "approach")


def recorded_drive(path: Path, robots: Config) -> Drive:
    """What the images showed and how the wheels turned while the robot approached.

    Args:
        path: of a recording, as ``davpc sim --record`` or the process ``follower-recorder`` leaves it.
        robots: as they were configured in it.

    Raises:
        ConfigError: no recording, none of an approach, or with another lens, mounting or array.
    """
    recording = Recording.read(path)
    tag = geometry_tag(robots)
    if geometry_tag(recording.config) != tag:
        raise ConfigError(f"{path}: recorded with another lens, mounting or array: name its --config")
    stamps = [header.stamp_ns for _, header, mission in recording.messages(MISSION) if mission.phase in _APPROACH]
    begin_ns, end_ns = (min(stamps), max(stamps)) if stamps else (0, -1)
    states: dict[int, DockingState] = {}
    for _, _, state in recording.messages(DOCKING_STATE):
        if state.geometry not in ("", tag):
            raise ConfigError(f"{path}: recorded with taught images: record without docking.taught_dir")
        if state.cause == "ok" and begin_ns <= state.capture_ns <= end_ns and _whole(state):
            states[state.capture_ns] = state
    turned = {
        drives.measured_ns: drives.wheel_angle_rad
        for _, _, drives in recording.messages(DRIVES)
        if begin_ns <= drives.measured_ns <= end_ns
    }
    leds = len(robots.leds.points)
    if len(states) < 2 or len(turned) < 2 or any(len(state.features) != leds for state in states.values()):
        raise ConfigError(f"{path}: holds no approach in which the array of {leds} LEDs was seen")
    unseen = (math.nan, math.nan)
    frames, wheels = sorted(states), sorted(turned)
    return Drive(
        frames_ns=np.array(frames),
        features=np.array([[point or unseen for point in states[time_ns].features] for time_ns in frames]),
        poses=np.array([(states[t].x_m, states[t].y_m, states[t].theta_rad) for t in frames]),
        wheels_ns=np.array(wheels),
        wheel_angle_rad=np.array([turned[time_ns] for time_ns in wheels]),
    )


def _whole(state: DockingState) -> bool:
    return sum(point is not None for point in state.features) >= FEWEST_LEDS
