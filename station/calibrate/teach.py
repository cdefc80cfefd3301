"""``davpc teach K``: the desired image of docking K, captured at the docked pose.

Averaged over frames and refused if anything moved; stored with its pose and the hash of the calibration that it was
taken with, and compared with the desired features that the geometry gives.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from common.config import Config
from common.geometry import Array, Pose2, features_at
from follower.estimator.lens import Lens
from follower.model.taught import Taught, calibration_hash, geometry_tag, taught_robots
from station.calibrate.mount import FEWEST_FRAMES, STEADY_PX


class TeachError(Exception):
    """Frames from which no desired image can be taken; one line that says why."""


def teach(config: Config, trolley: int, features: Sequence[Array], poses: Sequence[Pose2]) -> Taught:
    """Average the frames that show every LED; a few may not, as a coasting one does not.

    Args:
        config: the robots.
        trolley: K, from 1.
        features: (n, 2) of each frame, NaN where a LED was not seen.
        poses: fitted pose of each frame.

    Raises:
        TeachError: too few frames, a LED not seen, or something moved.
    """
    if len(poses) != len(features):
        raise ValueError(f"{len(features)} frames with {len(poses)} poses")
    whole = [row for row, one in enumerate(features) if np.isfinite(one).all()]
    if len(whole) < FEWEST_FRAMES:
        raise TeachError(_too_few(features, len(whole)))
    stack = np.array([features[row] for row in whole])
    focal = config.camera.lens.fx_px
    spread_px = float(stack.std(axis=0).max()) * focal
    half = len(stack) // 2
    drift_px = float(np.abs(stack[:half].mean(axis=0) - stack[half:].mean(axis=0)).max()) * focal
    if max(spread_px, drift_px) > STEADY_PX:
        raise TeachError(f"features move by {max(spread_px, drift_px):.2f} px: robots at rest? bound {STEADY_PX} px")
    mean = stack.mean(axis=0)
    computed = features_at(config.leds.points, config.docking.goal(trolley), config.camera.mount)
    offset_px = float(np.hypot(*(mean - computed).T).max()) * focal
    pose = np.array([poses[row].as_array() for row in whole]).mean(axis=0)
    return Taught(
        trolley,
        mean,
        spread_px,
        Pose2(float(pose[0]), float(pose[1]), float(pose[2])),
        calibration_hash(config.camera),
        offset_px,
        len(stack),
    )


def as_configured(config: Config, config_path: Path, geometry: str, features: Sequence[Array]) -> list[Array]:
    """Features of a running estimator as lens and mounting of the configuration give them: what is stored.

    Args:
        config: the robots.
        config_path: beside it lie the images that may have corrected the estimator's geometry.
        geometry: tag of the estimator's geometry; empty: as configured.
        features: (n, 2) of each frame, NaN where a LED was not seen.

    Raises:
        TeachError: the estimator goes by neither.
    """
    if geometry in ("", geometry_tag(config)):
        return list(features)
    corrected = taught_robots(config, config_path)
    if geometry != geometry_tag(corrected):
        raise TeachError("the estimator goes by another configuration or other images: restart it, then teach")
    used, configured = Lens(corrected.camera), Lens(config.camera)
    return [configured.to_normalised(used.to_pixels(one)) for one in features]


def _too_few(features: Sequence[Array], whole: int) -> str:
    """What keeps the frames from being enough: no array in them, or LEDs that are missing of it."""
    partly = [np.isfinite(one).all(axis=1) for one in features if np.isfinite(one).any()]
    text = f"{whole} of {len(features)} frames show every LED, at least {FEWEST_FRAMES} are needed"
    missing = np.flatnonzero(~np.all(partly, axis=0)) if partly else np.empty(0)
    return text + (f": LED {', '.join(map(str, missing))} is not always seen" if len(missing) else "")
