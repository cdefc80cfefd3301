"""``davpc teach K``: the desired image of docking K, captured at the docked pose.

Averaged over frames and refused if anything moved; stored with its pose and the hash of the calibration that it was
taken with, and compared with the desired features that the geometry gives.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from common.config import CameraConfig, Config
from common.geometry import Array, Pose2, features_at

_FEWEST_FRAMES = 30
_STEADY_PX = 0.5
_SCHEMA = "taught/1"


class TeachError(Exception):
    """Frames from which no desired image can be taken; one line that says why."""


@dataclass(frozen=True)
class Taught:
    """The desired image of one docking.

    Attributes:
        trolley: K.
        features: (n, 2) normalised desired coordinates by LED.
        spread_px: largest standard deviation of a coordinate over the frames.
        pose: mean fitted pose of {L} in {F}.
        calibration: hash of lens and mounting.
        offset_px: largest distance from the features that the geometry gives at docking K's goal.
        frames: images averaged.
    """

    trolley: int
    features: Array
    spread_px: float
    pose: Pose2
    calibration: str
    offset_px: float
    frames: int


def calibration_hash(camera: CameraConfig) -> str:
    """Short hash of what the desired image depends on: image size, lens and mounting."""
    relevant = camera.model_dump(include={"width_px", "height_px", "mount_xyz_m", "lens"}, mode="json")
    return hashlib.sha256(json.dumps(relevant, sort_keys=True).encode()).hexdigest()[:16]


def teach(config: Config, trolley: int, features: Sequence[Array], poses: Sequence[Pose2]) -> Taught:
    """Average the frames.

    Args:
        config: the robots.
        trolley: K, from 1.
        features: (n, 2) of each frame, every LED seen.
        poses: fitted pose of each frame.

    Raises:
        TeachError: too few frames, a LED not seen, or something moved.
    """
    if len(features) < _FEWEST_FRAMES or len(poses) != len(features):
        raise TeachError(f"{len(features)} frames with {len(poses)} poses, at least {_FEWEST_FRAMES} are needed")
    stack = np.array(features)
    unseen = np.flatnonzero(~np.isfinite(stack).all(axis=(0, 2)))
    if len(unseen):
        raise TeachError(f"LED {', '.join(str(led) for led in unseen)} is not seen in every frame")
    focal = config.camera.lens.fx_px
    spread_px = float(stack.std(axis=0).max()) * focal
    half = len(stack) // 2
    drift_px = float(np.abs(stack[:half].mean(axis=0) - stack[half:].mean(axis=0)).max()) * focal
    if max(spread_px, drift_px) > _STEADY_PX:
        raise TeachError(f"features move by {max(spread_px, drift_px):.2f} px: robots at rest? bound {_STEADY_PX} px")
    mean = stack.mean(axis=0)
    computed = features_at(config.leds.points, config.docking.goal(trolley), config.camera.mount)
    offset_px = float(np.hypot(*(mean - computed).T).max()) * focal
    pose = np.array([one.as_array() for one in poses]).mean(axis=0)
    return Taught(
        trolley,
        mean,
        spread_px,
        Pose2(float(pose[0]), float(pose[1]), float(pose[2])),
        calibration_hash(config.camera),
        offset_px,
        len(stack),
    )


def save(taught: Taught, path: Path) -> None:
    """Write it as JSON."""
    table = {"schema": _SCHEMA, **asdict(taught), "features": taught.features.tolist()}
    path.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")


def load(path: Path, camera: CameraConfig) -> Taught:
    """Read a desired image.

    Raises:
        TeachError: not such a file, or taken with another calibration.
    """
    try:
        table = json.loads(path.read_text(encoding="utf-8"))
        if table.pop("schema") != _SCHEMA:
            raise TeachError(f"{path}: not a desired image of schema {_SCHEMA}")
        taught = Taught(**{**table, "features": np.array(table["features"]), "pose": Pose2(**table["pose"])})
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise TeachError(f"{path}: not a desired image: {type(error).__name__}: {error}") from error
    if taught.calibration != calibration_hash(camera):
        raise TeachError(f"{path}: taught with another lens or mounting: teach docking {taught.trolley} again")
    return taught
