"""Desired images on disk: stored by ``davpc teach K``, used by the supervisor if ``docking.taught_dir`` is set."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from common.config import CameraConfig, Config
from common.errors import ConfigError
from common.geometry import Array, Pose2

_SCHEMA = "taught/1"


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
    keys = {"width_px", "height_px", "mount_xyz_m", "mount_tilt_deg", "lens"}
    relevant = camera.model_dump(include=keys, mode="json")
    return hashlib.sha256(json.dumps(relevant, sort_keys=True).encode()).hexdigest()[:16]


def taught_name(trolley: int) -> str:
    """Name of docking K's file."""
    return f"taught-{trolley}.json"


def save(taught: Taught, path: Path) -> None:
    """Write it as JSON."""
    table = {"schema": _SCHEMA, **asdict(taught), "features": taught.features.tolist()}
    path.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")


def load(path: Path, camera: CameraConfig) -> Taught:
    """Read a desired image.

    Raises:
        ConfigError: not such a file, or taken with another calibration.
    """
    try:
        table = json.loads(path.read_text(encoding="utf-8"))
        schema = table.pop("schema")
        taught = Taught(
            **{**table, "features": np.array(table["features"], dtype=np.float64), "pose": Pose2(**table["pose"])}
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ConfigError(f"{path}: not a desired image: {type(error).__name__}: {error}") from error
    if schema != _SCHEMA:
        raise ConfigError(f"{path}: not a desired image of schema {_SCHEMA}")
    if taught.calibration != calibration_hash(camera):
        raise ConfigError(f"{path}: taught with another lens or mounting: teach docking {taught.trolley} again")
    return taught


def taught_images(config: Config, config_path: Path) -> dict[int, Array] | None:
    """Desired features (n, 2) by trolley from ``docking.taught_dir``; None: from geometry.

    A relative folder lies beside the configuration.

    Raises:
        ConfigError: no image for trolley 1, or an image that is corrupt, or of another calibration, array or docking.
    """
    if not config.docking.taught_dir:
        return None
    folder = config_path.parent / config.docking.taught_dir
    first = folder / taught_name(1)
    if not first.is_file():
        raise ConfigError(f"docking.taught_dir: {first} is missing: run davpc teach 1 at the docked pose")
    found: dict[int, Array] = {}
    for path in sorted(folder.glob("taught-*.json")):
        taught = load(path, config.camera)
        if path.name != taught_name(taught.trolley):
            raise ConfigError(f"{path}: contains the image of docking {taught.trolley}")
        if taught.features.shape != config.leds.points[:, :2].shape or not np.isfinite(taught.features).all():
            raise ConfigError(f"{path}: not one point for each of the {len(config.leds.points)} LEDs")
        found[taught.trolley] = taught.features
    return found
