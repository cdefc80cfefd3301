"""Desired images on disk: stored by ``davpc teach K``; with ``docking.taught_dir`` set they correct the geometry.

Estimator, controller and supervisor correct their configuration alike, each at its start.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from common.config import CameraConfig, Config, Coordinate, NonNegative, Section, validate
from common.errors import ConfigError
from common.files.parsing import UnreadableError, parse_json, read_text
from common.files.writer import replace_file
from common.geometry import Array, Pose2
from follower.model.taught_geometry import TaughtGeometry, corrected

_SCHEMA = "taught/1"
# beyond: the LEDs are in another order, the image is of another docking, or a measure is grossly wrong
_MOST_UNEXPLAINED_PX = 0.5
_MOST_SIGMAS = 6.0


@dataclass(frozen=True)
class Taught:
    """The desired image of one docking.

    Attributes:
        trolley: K.
        features: (n, 2) coordinates by LED, not levelled, normalised by lens and mounting as configured.
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


class _StoredPose(Section):
    x_m: Coordinate
    y_m: Coordinate
    theta_rad: Coordinate


class _StoredImage(Section):
    """The file's fields but its schema, as :class:`Taught` describes them."""

    trolley: Annotated[int, Field(ge=1, le=99)]
    features: tuple[tuple[Coordinate, Coordinate], ...]
    spread_px: NonNegative
    pose: _StoredPose
    calibration: Annotated[str, Field(max_length=100)]
    offset_px: NonNegative
    frames: Annotated[int, Field(ge=1, lt=2**31)]


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
    replace_file(path, json.dumps(table, indent=1) + "\n")


def load(path: Path, camera: CameraConfig) -> Taught:
    """Read a desired image.

    Raises:
        ConfigError: not such a file, or taken with another calibration.
    """
    try:
        table = parse_json(read_text(path))
    except OSError as error:
        raise ConfigError(f"{path}: not a desired image: {error.strerror}") from error
    except UnreadableError as error:
        raise ConfigError(f"{path}: not a desired image: {error}") from error
    if not isinstance(table, dict) or table.pop("schema", None) != _SCHEMA:
        raise ConfigError(f"{path}: not a desired image of schema {_SCHEMA}")
    stored = validate(_StoredImage, table, f"{path}: not a desired image")
    pose = stored.pose
    taught = Taught(
        trolley=stored.trolley,
        features=np.array(stored.features, dtype=np.float64),
        spread_px=stored.spread_px,
        pose=Pose2(pose.x_m, pose.y_m, pose.theta_rad),
        calibration=stored.calibration,
        offset_px=stored.offset_px,
        frames=stored.frames,
    )
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
        if taught.features.shape != config.leds.points[:, :2].shape:
            raise ConfigError(f"{path}: not one point for each of the {len(config.leds.points)} LEDs")
        found[taught.trolley] = taught.features
    return found


def taught_geometry(config: Config, config_path: Path) -> TaughtGeometry | None:
    """Camera and LEDs as the images of ``docking.taught_dir`` show them; None without any.

    Raises:
        ConfigError: as :func:`taught_images`, or errors within their tolerances do not explain the images.
    """
    images = taught_images(config, config_path)
    if images is None:
        return None
    found = corrected(config, images)
    if found.unexplained_px > _MOST_UNEXPLAINED_PX or found.sigmas > _MOST_SIGMAS:
        raise ConfigError(
            f"docking.taught_dir: {config.docking.taught_dir}: the images differ from camera and LEDs as configured "
            f"by {found.sigmas:.0f} times docking.taught's tolerances ({found.unexplained_px:.1f} px unexplained): "
            "measure camera and LEDs, or teach again"
        )
    return found


def taught_robots(config: Config, config_path: Path) -> Config:
    """The configuration that estimator and controller go by: corrected by taught images, if there are any.

    Raises:
        ConfigError: as :func:`taught_geometry`.
    """
    found = taught_geometry(config, config_path)
    return config if found is None else found.config


def geometry_tag(config: Config) -> str:
    """Short hash of what features and poses depend on: lens, mounting and LEDs."""
    relevant = [calibration_hash(config.camera), config.leds.model_dump(include={"positions_m"}, mode="json")]
    return hashlib.sha256(json.dumps(relevant, sort_keys=True).encode()).hexdigest()[:16]
