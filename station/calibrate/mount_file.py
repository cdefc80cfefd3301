"""Views of the array on disk: JSON, ``[{"pose": [x_m, y_m, theta_deg], "features": [[alpha, beta], …]}, …]``.

A LED that was not seen is null. The pose is the measured one of {L} in {F}.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from common.errors import ConfigError
from common.geometry import Pose2
from station.calibrate.mount import MountView

_UNSEEN = (math.nan, math.nan)


def load_views(path: Path, leds: int) -> list[MountView]:
    """Read them.

    Raises:
        ConfigError: not such a file; names what is wrong in it.
    """
    try:
        table = json.loads(path.read_text(encoding="utf-8"))
        views = []
        for entry in table:
            x_m, y_m, theta_deg = (float(value) for value in entry["pose"])
            features = [_UNSEEN if point is None else point for point in entry["features"]]
            views.append(MountView(Pose2(x_m, y_m, math.radians(theta_deg)), np.array(features, dtype=np.float64)))
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}") from error
    except (ValueError, KeyError, TypeError) as error:
        raise ConfigError(f"{path}: not a list of views: {type(error).__name__}: {error}") from error
    wrong = [number for number, view in enumerate(views, 1) if view.features.shape != (leds, 2)]
    if wrong:
        raise ConfigError(f"{path}: view {wrong[0]} has not one point for each of the {leds} LEDs")
    infinite = [number for number, view in enumerate(views, 1) if not _finite(view)]
    if infinite:
        raise ConfigError(f"{path}: view {infinite[0]}: pose or points are not finite numbers; a hidden LED is null")
    return views


def save_views(views: Sequence[MountView], path: Path) -> None:
    """Write them."""
    table = [
        {
            "pose": [view.relative.x_m, view.relative.y_m, math.degrees(view.relative.theta_rad)],
            "features": [None if math.isnan(a) else [float(a), float(b)] for a, b in view.features],
        }
        for view in views
    ]
    path.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")


def _finite(view: MountView) -> bool:
    """A LED that was not seen is NaN in both coordinates, never in one."""
    halves = np.isnan(view.features).any(axis=1) != np.isnan(view.features).all(axis=1)
    return (
        bool(np.isfinite(view.relative.as_array()).all()) and not np.isinf(view.features).any() and not halves.any()
    )
