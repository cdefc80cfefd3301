"""A camera's calibration on disk: TOML whose table ``[lens]`` is what ``camera.lens`` of the configuration takes."""

from __future__ import annotations

import json
import tomllib
from datetime import date
from pathlib import Path

from common.config import CameraConfig, LensConfig, Section, validate
from common.errors import ConfigError
from station.calibrate.board import Size
from station.calibrate.lens import Calibration, holds


class StoredCalibration(Section):
    """Lens, its camera's serial number, when it was calibrated (ISO 8601), and how well."""

    camera: str
    date: str
    width_px: int
    height_px: int
    rms_px: float
    held_out_px: float
    coverage: float
    views: int
    lens: LensConfig


def store(calibration: Calibration, camera: str, made: str, size: Size, path: Path) -> None:
    """Write it.

    Args:
        calibration: the lens.
        camera: serial number.
        made: date, as ISO 8601.
        size: width and height of the images [px].
        path: of the file.
    """
    lens = calibration.lens
    held_out = min(calibration.held_out_px.values())
    lines = [
        "# made by: davpc calibrate camera",
        f"camera = {json.dumps(camera)}",
        f"date = {json.dumps(made)}",
        f"width_px = {size[0]}",
        f"height_px = {size[1]}",
        f"rms_px = {calibration.rms_px!r}",
        f"held_out_px = {held_out!r}",
        f"coverage = {calibration.coverage.share!r}",
        f"views = {calibration.views}",
        "",
        "[lens]",
        f"model = {json.dumps(lens.model)}",
        *(f"{key} = {getattr(lens, key)!r}" for key in ("fx_px", "fy_px", "cx_px", "cy_px")),
        f"coefficients = {list(lens.coefficients)!r}",
        "",
    ]
    path.write_text("\n".join(lines), encoding="utf-8")


def stored(path: Path) -> StoredCalibration:
    """Read it.

    Raises:
        ConfigError: not such a file; names the key.
    """
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: not a calibration: {error}") from error
    return validate(StoredCalibration, table, str(path))


def differences(calibration: StoredCalibration, camera: CameraConfig) -> list[str]:
    """Where the configured camera is not the calibrated one, or its lens does not hold over the whole image.

    Returns:
        One text each; empty if all is well.
    """
    size, wanted = (camera.width_px, camera.height_px), (calibration.width_px, calibration.height_px)
    found = [] if size == wanted else [f"image {size[0]}×{size[1]} instead of {wanted[0]}×{wanted[1]}"]
    keys = ["model"] if camera.lens.model != calibration.lens.model else LensConfig.model_fields
    for key in keys:
        configured, calibrated = getattr(camera.lens, key), getattr(calibration.lens, key)
        if configured != calibrated:
            found.append(f"camera.lens.{key} = {configured} instead of {calibrated}")
    if not holds(camera.lens, size):
        found.append("a camera.lens that does not hold over the whole image: calibrate it again")
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
