"""A recorded approach: what each image showed, and how far the wheels had turned."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from common.config import Config, Coordinate, Section, validate
from common.errors import ConfigError
from common.files.parsing import UnreadableError, parse_json, read_text
from common.geometry import Array
from follower.model.taught import geometry_tag

_SCHEMA = "drive/1"
MOST_SAMPLES = 60_000  # ten minutes of wheels

Stamp = Annotated[int, Field(ge=0, lt=2**63)]
Angle = Annotated[float, Field(ge=-1e6, le=1e6, allow_inf_nan=False)]


@dataclass(frozen=True)
class Drive:
    """One approach.

    Attributes:
        frames_ns: (k,) middle of each exposure, rising.
        features: (k, n, 2) not levelled, normalised by lens and mounting as configured; NaN where not seen.
        poses: (k, 3) estimated x [m], y [m], θ [rad] of {L} in {F}: where the fit begins.
        wheels_ns: (m,) times of the wheels' measurements, rising.
        wheel_angle_rad: (m, 2) left and right, by the configured gears.
    """

    frames_ns: Array
    features: Array
    poses: Array
    wheels_ns: Array
    wheel_angle_rad: Array


class _StoredFrame(Section):
    capture_ns: Stamp
    features: tuple[tuple[Coordinate, Coordinate] | None, ...]
    pose: tuple[Coordinate, Coordinate, Coordinate]


class _StoredDrive(Section):
    geometry: Annotated[str, Field(max_length=100)]
    frames: Annotated[tuple[_StoredFrame, ...], Field(max_length=MOST_SAMPLES)]
    wheels: Annotated[tuple[tuple[Stamp, Angle, Angle], ...], Field(max_length=MOST_SAMPLES)]


def save_drive(drive: Drive, config: Config, path: Path) -> None:
    """Write it as JSON.

    Args:
        drive: the approach.
        config: the robots as they were configured in it.
        path: of the file.
    """
    frames = [
        {
            "capture_ns": int(time_ns),
            "features": [None if math.isnan(a) else [float(a), float(b)] for a, b in seen],
            "pose": pose.tolist(),
        }
        for time_ns, seen, pose in zip(drive.frames_ns, drive.features, drive.poses, strict=True)
    ]
    wheels = [
        [int(time_ns), *map(float, angles)]
        for time_ns, angles in zip(drive.wheels_ns, drive.wheel_angle_rad, strict=True)
    ]
    table = {"schema": _SCHEMA, "geometry": geometry_tag(config), "frames": frames, "wheels": wheels}
    path.write_text(json.dumps(table) + "\n", encoding="utf-8")


def load_drive(path: Path, config: Config) -> Drive:
    """Read one.

    Raises:
        ConfigError: not such a file, or recorded with another lens, mounting or array than configured.
    """
    try:
        table = parse_json(read_text(path))
    except OSError as error:
        raise ConfigError(f"{path}: not a recorded drive: {error.strerror}") from error
    except UnreadableError as error:
        raise ConfigError(f"{path}: not a recorded drive: {error}") from error
    if not isinstance(table, dict) or table.pop("schema", None) != _SCHEMA:
        raise ConfigError(f"{path}: not a recorded drive of schema {_SCHEMA}")
    stored = validate(_StoredDrive, table, f"{path}: not a recorded drive")
    if stored.geometry != geometry_tag(config):
        raise ConfigError(
            f"{path}: recorded with another lens, mounting or array: record again, or name its --config"
        )
    leds = len(config.leds.points)
    if not stored.frames or not stored.wheels or any(len(frame.features) != leds for frame in stored.frames):
        raise ConfigError(f"{path}: a drive needs wheels, and frames with one point for each of the {leds} LEDs")
    unseen = (math.nan, math.nan)
    drive = Drive(
        frames_ns=np.array([frame.capture_ns for frame in stored.frames]),
        features=np.array([[point or unseen for point in frame.features] for frame in stored.frames]),
        poses=np.array([frame.pose for frame in stored.frames]),
        wheels_ns=np.array([row[0] for row in stored.wheels]),
        wheel_angle_rad=np.array([row[1:] for row in stored.wheels]),
    )
    if (np.diff(drive.frames_ns) <= 0).any() or (np.diff(drive.wheels_ns) <= 0).any():
        raise ConfigError(f"{path}: stamps do not rise")
    return drive
