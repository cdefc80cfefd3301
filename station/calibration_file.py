"""A camera's calibration on disk: TOML whose table ``[lens]`` is what ``camera.lens`` of the configuration takes."""

from __future__ import annotations

import json
import tomllib
from dataclasses import dataclass
from pathlib import Path

from common.config import ConfigError, LensConfig, Section, validate
from station.calibration import Calibration, Size


@dataclass(frozen=True)
class StoredCalibration:
    """Lens, whose it is, and how it came about."""

    camera: str
    date: str
    size: Size
    lens: LensConfig
    rms_px: float
    held_out_px: float
    coverage: float
    views: int


class _File(Section):
    camera: str
    date: str
    width_px: int
    height_px: int
    rms_px: float
    held_out_px: float
    coverage: float
    views: int
    lens: LensConfig


def store(calibration: Calibration, camera: str, date: str, size: Size, path: Path) -> None:
    """Write it; ``camera`` is the serial number, ``date`` as ISO 8601."""
    lens = calibration.lens
    held_out = min(calibration.held_out_px.values())
    lines = [
        "# made by: davpc calibrate camera",
        f"camera = {json.dumps(camera)}",
        f"date = {json.dumps(date)}",
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
    found = validate(_File, table, str(path))
    return StoredCalibration(
        found.camera,
        found.date,
        (found.width_px, found.height_px),
        found.lens,
        found.rms_px,
        found.held_out_px,
        found.coverage,
        found.views,
    )
