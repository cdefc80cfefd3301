"""``davpc calibrate robot``: camera, LEDs, wheels and latency from recorded drives."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from common.config import Config
from common.errors import ConfigError
from common.geometry import Array
from follower.calibration.bundle import CoverageError, RobotCalibration, calibrate_robot
from station.calibrate.recorded_drive import recorded_drive

_WORST_PX = 1.0
_DISPLAYED = {"m": (1e3, "mm"), "deg": (1.0, "°"), "": (100.0, "%"), "s": (1e3, "ms")}


def fitted(drives: list[Path], robots: Config) -> RobotCalibration:
    """Fit a robot to recorded drives.

    Args:
        drives: files, three or more, of approaches from different sides.
        robots: as they were configured in them.

    Raises:
        ConfigError: a file is no drive of these robots, the drives are too much alike, or one robot does not explain
            them.
    """
    recorded = [recorded_drive(path, robots) for path in drives]
    try:
        found = calibrate_robot(recorded, robots)
    except CoverageError as error:
        raise ConfigError(f"calibrate robot: {error}") from error
    if found.residual_px > _WORST_PX:
        raise ConfigError(
            f"calibrate robot: {found.residual_px:.1f} px are left unexplained, at most {_WORST_PX:.0f} may be: "
            "are the drives of this robot, before one Leader that stood still?"
        )
    return found


def table(found: RobotCalibration) -> str:
    """One line for each error, with its standard deviation, and what the drives do not determine.

    Args:
        found: the calibration.
    """
    lines = [f"{found.images} images, {found.residual_px:.3f} px"]
    for name, unit, value, sigma, seen in zip(
        found.names, found.units, found.values, found.sigma, found.observable, strict=True
    ):
        scale, shown = _DISPLAYED[unit]
        doubt = "" if seen else "   not determined by these drives"
        lines.append(f"{name:13s} {scale * value:+8.3f} ± {scale * sigma:.3f} {shown}{doubt}")
    return "\n".join(lines)


def content(found: RobotCalibration, made: str, drives: list[Path]) -> dict[str, Any]:
    """What the file holds.

    Args:
        found: the calibration.
        made: date, as ISO 8601.
        drives: it was made from.
    """
    camera, can = found.config.camera, found.config.follower_can
    return {
        "schema": "robot-calibration/1",
        "date": made,
        "drives": [str(path) for path in drives],
        "images": found.images,
        "residual_px": found.residual_px,
        "errors": {
            name: {"value": float(value), "sigma": float(sigma), "unit": unit, "determined": seen}
            for name, unit, value, sigma, seen in zip(
                found.names, found.units, found.values, found.sigma, found.observable, strict=True
            )
        },
        "covariance": _rows(found.covariance),
        "configuration": {
            "camera.mount_xyz_m": list(camera.mount_xyz_m),
            "camera.mount_tilt_deg": list(camera.mount_tilt_deg),
            "camera.lens.fx_px": camera.lens.fx_px,
            "camera.lens.fy_px": camera.lens.fy_px,
            "leds.positions_m": [list(point) for point in found.config.leds.positions_m],
            "base.track_m": found.config.base.track_m,
            "follower_can.left_wheel.gear_ratio": can.left_wheel.gear_ratio,
            "follower_can.right_wheel.gear_ratio": can.right_wheel.gear_ratio,
        },
    }


def _rows(matrix: Array) -> list[list[float]]:
    rows: list[list[float]] = np.asarray(matrix).tolist()
    return rows
