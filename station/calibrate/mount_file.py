"""Views of the array on disk: JSON, ``[{"pose": [x_m, y_m, theta_deg], "features": [[alpha, beta], …]}, …]``.

A LED that was not seen is null. The pose is the measured one of {L} in {F}.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from common.config import Coordinate, Section, validate
from common.errors import ConfigError
from common.files.parsing import UnreadableError, parse_json, read_text
from common.files.writer import replace_file
from common.geometry import Pose2
from station.calibrate.mount import MountView

_UNSEEN = (math.nan, math.nan)


class _StoredView(Section):
    pose: tuple[Coordinate, Coordinate, Annotated[float, Field(ge=-360.0, le=360.0)]]
    features: tuple[tuple[Coordinate, Coordinate] | None, ...]


class _StoredViews(Section):
    views: tuple[_StoredView, ...]


def load_views(path: Path, leds: int) -> list[MountView]:
    """Read them.

    Raises:
        ConfigError: not such a file; names what is wrong in it.
    """
    try:
        table = parse_json(read_text(path))
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}") from error
    except UnreadableError as error:
        raise ConfigError(f"{path}: not a list of views: {error}; a hidden LED is null") from error
    stored = validate(_StoredViews, {"views": table}, f"{path}: not a list of views").views
    wrong = [number for number, view in enumerate(stored, 1) if len(view.features) != leds]
    if wrong:
        raise ConfigError(f"{path}: view {wrong[0]} has not one point for each of the {leds} LEDs")
    return [_view(each) for each in stored]


def save_views(views: Sequence[MountView], path: Path) -> None:
    """Write them."""
    table = [
        {
            "pose": [view.relative.x_m, view.relative.y_m, math.degrees(view.relative.theta_rad)],
            "features": [None if math.isnan(a) else [float(a), float(b)] for a, b in view.features],
        }
        for view in views
    ]
    replace_file(path, json.dumps(table, indent=1) + "\n")


def _view(stored: _StoredView) -> MountView:
    """A LED that was not seen is NaN in both coordinates."""
    x_m, y_m, theta_deg = stored.pose
    features = [_UNSEEN if point is None else point for point in stored.features]
    return MountView(Pose2(x_m, y_m, math.radians(theta_deg)), np.array(features, dtype=np.float64))
