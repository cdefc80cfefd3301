"""A camera's calibration, written and compared with the configuration; its form is in ``follower/camera``."""

from __future__ import annotations

import json
from pathlib import Path

from common.config import CameraConfig
from common.files.writer import replace_file
from follower.camera.calibration_file import StoredCalibration, unlike
from station.calibrate.board import Size
from station.calibrate.lens import Calibration, holds


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
    replace_file(path, "\n".join(lines))


def differences(calibration: StoredCalibration, camera: CameraConfig) -> list[str]:
    """Where the configured camera is not the calibrated one, or its lens does not hold over the whole image.

    Returns:
        One text each; empty if all is well.
    """
    found = unlike(calibration, camera)
    if not holds(camera.lens, (camera.width_px, camera.height_px)):
        found.append("a camera.lens that does not hold over the whole image: calibrate it again")
    return found
