"""What approaches through a scene amount to: locks, losses, wrong LEDs, and errors of the pose beside the bound."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from common.config import Config
from experiments.perception.approach import RATE_HZ, Look, features_px
from experiments.perception.pose_bound import pose_bound

BANDS_M = ((8.5, 6.0), (6.0, 4.0), (4.0, 2.5), (2.5, 1.0))
_LOSS_FRAMES = round(0.1 * RATE_HZ)
_ENOUGH_LEDS = 3
_BOUND_EVERY = 10
_POSE_FIGURES = (
    "sigma_px",
    "x_rms_cm",
    "y_rms_cm",
    "theta_rms_deg",
    "fit_x_rms_cm",
    "fit_y_rms_cm",
    "fit_theta_rms_deg",
    "theta_homography_rms_deg",
    "x_bound_cm",
    "y_bound_cm",
    "theta_bound_deg",
)
Figures = dict[str, Any]


@dataclass(frozen=True)
class Gap:
    """An invalid stretch after the first lock: where it began, whether three LEDs were in sight then, frames in
    sight at its end, its length, and how far the array was.
    """

    in_sight: bool
    visible_frames: int
    length: int
    distance_m: float

    @property
    def is_loss(self) -> bool:
        """Longer than 100 ms."""
        return self.length > _LOSS_FRAMES

    @property
    def relock_s(self) -> float:
        """From LEDs in sight again to the next valid frame."""
        return (self.visible_frames - 1) / RATE_HZ


def scene_metrics(approaches: Sequence[Sequence[Look]]) -> Figures:
    """Counts over all approaches of one scene.

    A frame counts as valid if it showed the array itself. ``losses`` are invalid stretches longer than 100 ms after
    the first lock, and approaches without any lock; ``losses_leds_visible`` those that began with three LEDs or more
    in sight; ``ambiguous_percent`` frames in which the array could not be distinguished from another; ``late_flags``
    valid frames that use LEDs not visible; ``relock_max_s`` the longest time from LEDs in sight again to the next
    valid frame.
    """
    locks = [_first_lock(looks) for looks in approaches]
    gaps = [gap for looks in approaches for gap in _gaps(looks)]
    never = [looks for looks, lock in zip(approaches, locks, strict=True) if lock is None]
    every = [look for looks in approaches for look in looks]
    found = [lock / RATE_HZ for lock in locks if lock is not None]
    return {
        "frames": len(every),
        "valid_percent": 100.0 * sum(look.measured for look in every) / len(every),
        "never_locked": len(never),
        "lock_median_s": float(np.median(found)) if found else None,
        "lock_max_s": max(found, default=None),
        "losses": sum(gap.is_loss for gap in gaps) + len(never),
        "losses_leds_visible": sum(gap.is_loss and gap.in_sight for gap in gaps)
        + sum(int(looks[0].visible.sum()) >= _ENOUGH_LEDS for looks in never),
        "ambiguous_percent": 100.0 * sum(look.detection.cause == "ambiguous" for look in every) / len(every),
        "relock_max_s": max((gap.relock_s for gap in gaps if gap.is_loss), default=0.0),
        "late_flags": sum(look.detection.leds_seen > int(look.visible.sum()) for look in every if look.measured),
        "wrong_led_frames": sum(look.measured and look.wrong_leds > 0 for look in every),
        "false_locks": sum(look.false_lock for look in every),
    }


def _first_lock(looks: Sequence[Look]) -> int | None:
    return next((row for row, look in enumerate(looks) if look.measured), None)


def _gaps(looks: Sequence[Look]) -> list[Gap]:
    gaps = []
    start: int | None = None
    lock = _first_lock(looks)
    for row in range(lock if lock is not None else len(looks), len(looks)):
        valid = looks[row].measured
        if not valid and start is None:
            start = row
        if start is not None and (valid or row == len(looks) - 1):
            in_sight = [int(look.visible.sum()) >= _ENOUGH_LEDS for look in looks[start : row + 1]]
            tail = in_sight[::-1].index(False) if False in in_sight else len(in_sight)
            gaps.append(Gap(in_sight[0], tail, row - start, looks[start].view.relative.x_m))
            start = None
    return gaps


def band_metrics(
    config: Config, approaches: Sequence[Sequence[Look]], far_m: float, near_m: float
) -> dict[str, float | None]:
    """The same counts for what happened between two distances, and the errors of both routes to the pose there.

    A lock and a loss belong to the distance at which they came about.

    Args:
        config: the robots.
        approaches: their frames.
        far_m: farthest distance, exclusive.
        near_m: nearest one.
    """

    def here(distance_m: float) -> bool:
        return near_m <= distance_m < far_m

    looks = [look for looks in approaches for look in looks if here(look.view.relative.x_m)]
    locks = [(_first_lock(looks), looks) for looks in approaches]
    found = [lock / RATE_HZ for lock, looks in locks if lock is not None and here(looks[lock].view.relative.x_m)]
    losses = [gap for looks in approaches for gap in _gaps(looks) if gap.is_loss and here(gap.distance_m)]
    measured = [look for look in looks if look.measured]
    counts = {
        "frames": len(looks),
        "valid_percent": 100.0 * len(measured) / len(looks) if looks else None,
        "locks": len(found),
        "lock_max_s": max(found, default=None),
        "losses": len(losses),
        "relock_max_s": max((gap.relock_s for gap in losses), default=None),
        "wrong_led_frames": sum(look.wrong_leds > 0 for look in measured),
        "false_locks": sum(look.false_lock for look in looks),
    }
    return counts | (_pose_metrics(config, measured) if measured else dict.fromkeys(_POSE_FIGURES))


def _pose_metrics(config: Config, looks: Sequence[Look]) -> dict[str, float | None]:
    """Errors of the filtered pose and of the frames' own fits, and the bound of a fit at the frames' own noise."""
    truth = np.array([look.view.relative.as_array() for look in looks])
    filtered = (
        np.array([(look.detection.x_m, look.detection.y_m, look.detection.theta_rad) for look in looks]) - truth
    )
    fit = np.array([_fit(look) for look in looks]) - truth
    decomposed = [
        look.detection.theta_homography_rad - look.view.relative.theta_rad
        for look in looks
        if look.detection.theta_homography_rad is not None
    ]
    away_px = np.array([features_px(config, look.detection) - look.leds_px for look in looks])
    sigma_px = float(np.sqrt(np.nanmean(away_px**2)))
    bounds = np.array([pose_bound(config, look.view.relative, sigma_px) for look in looks[::_BOUND_EVERY]])
    bound = np.sqrt((bounds**2).mean(axis=0))
    values = (
        sigma_px,
        100.0 * _rms(filtered[:, 0]),
        100.0 * _rms(filtered[:, 1]),
        math.degrees(_rms(filtered[:, 2])),
        100.0 * _rms(fit[:, 0]),
        100.0 * _rms(fit[:, 1]),
        math.degrees(_rms(fit[:, 2])),
        math.degrees(_rms(np.array(decomposed))) if decomposed else None,
        100.0 * float(bound[0]),
        100.0 * float(bound[1]),
        math.degrees(bound[2]),
    )
    return dict(zip(_POSE_FIGURES, values, strict=True))


def _fit(look: Look) -> tuple[float, float, float]:
    if look.detection.fit is None:
        raise ValueError(f"frame {look.view.frame_sequence} is valid without a fit")
    return look.detection.fit[:3]


def _rms(values: np.ndarray[Any, np.dtype[np.float64]]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
