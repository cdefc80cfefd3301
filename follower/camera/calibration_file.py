"""A camera's calibration on disk: TOML whose table ``[lens]`` is what ``camera.lens`` of the configuration takes.

``davpc calibrate camera`` writes it; the supervisor arms nothing with a lens that is another camera's, or too old.
"""

from __future__ import annotations

from datetime import date
from pathlib import Path

from common.config import CameraConfig, LensConfig, Section, validate
from common.errors import ConfigError
from common.files.parsing import UnreadableError, parse_toml, read_text


class StoredCalibration(Section):
    """Lens, whose it is (serial number), when it was made (ISO 8601), and how good it was."""

    camera: str
    date: str
    width_px: int
    height_px: int
    rms_px: float
    held_out_px: float
    coverage: float
    views: int
    lens: LensConfig


def stored(path: Path) -> StoredCalibration:
    """Read it.

    Raises:
        ConfigError: not such a file; names the key.
    """
    try:
        table = parse_toml(read_text(path))
    except OSError as error:
        raise ConfigError(f"{path}: not a calibration: {error.strerror}") from error
    except UnreadableError as error:
        raise ConfigError(f"{path}: not a calibration: {error}") from error
    return validate(StoredCalibration, table, str(path))


def unlike(calibration: StoredCalibration, camera: CameraConfig) -> list[str]:
    """Where the configured camera is not the calibrated one, one text each; empty if all is well."""
    size, wanted = (camera.width_px, camera.height_px), (calibration.width_px, calibration.height_px)
    found = [] if size == wanted else [f"image {size[0]}×{size[1]} instead of {wanted[0]}×{wanted[1]}"]
    keys = ["model"] if camera.lens.model != calibration.lens.model else LensConfig.model_fields
    for key in keys:
        configured, calibrated = getattr(camera.lens, key), getattr(calibration.lens, key)
        if configured != calibrated:
            found.append(f"camera.lens.{key} = {configured} instead of {calibrated}")
    return found


def age_days(calibration: StoredCalibration, today: date, path: Path) -> int:
    """Days since it was made.

    Raises:
        ConfigError: its date is none.
    """
    try:
        return (today - date.fromisoformat(calibration.date)).days
    except ValueError as error:
        raise ConfigError(f"{path}: date: {error}") from error
