"""``davpc experiment perception``: named scenes, 8 → 1.5 m, and both routes to the pose beside the bound.

``run`` writes ``results.json`` (rows of method, case, metrics), ``perception.md`` and one picture a scene with the
detections drawn.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from common.config import Config, default_config_path, load_config
from common.frame_ring import Image
from experiments.approach import PERIOD_NS, RATE_HZ, Look, approach, features_px
from experiments.identification import CASES, identification_rates
from experiments.pose_bound import pose_bound, theta_errors
from experiments.results import configuration, write_json
from follower.estimator.state import StateEstimator
from sim.optics import Optics
from sim.scenes import SCENES as SCENES
from sim.scenes import named_scene

BANDS_M = ((8.5, 6.0), (6.0, 4.0), (4.0, 2.5), (2.5, 1.0))
BOUND_DISTANCES_M = (1.5, 3.0, 6.0, 9.0)
REFERENCE_SIGMA_PX = 0.2
_LOSS_FRAMES = round(0.1 * RATE_HZ)
_ENOUGH_LEDS = 3
_BOUND_EVERY = 10
Row = dict[str, Any]


def run(
    out: Path,
    config: Config | None = None,
    seeds: int = 20,
    scenes: Sequence[str] = tuple(SCENES),
    trials: int = 1000,
) -> dict[str, Any]:
    """Run every scene with every seed and write what came of it.

    Args:
        out: folder for the results; made if missing.
        config: the robots; None: the default configuration.
        seeds: approaches per scene.
        scenes: names from :data:`sim.scenes.SCENES`.
        trials: noisy images per distance of the comparison with the bound, and random scenes per case of
            identification.
    """
    robots = config if config is not None else load_config(default_config_path())
    out.mkdir(parents=True, exist_ok=True)
    optics = Optics(robots.camera, robots.leds, seed=1)
    rows: list[Row] = []
    for name in scenes:
        looks = [
            list(approach(robots, optics, StateEstimator(robots), named_scene(name, seed), seed))
            for seed in range(seeds)
        ]
        rows.append({"method": robots.estimator.method, "case": name, "metrics": scene_metrics(looks)})
        rows += _band_rows(robots, name, looks)
        _write_picture(out / f"scene_{name}.png", optics, robots, looks[0][len(looks[0]) // 3])
    for error in theta_errors(robots, BOUND_DISTANCES_M, REFERENCE_SIGMA_PX, trials, seed=0):
        metrics = {
            "bound_deg": error.bound_deg,
            "planar_fit_deg": error.planar_fit_deg,
            "planar_fit_failed_percent": error.planar_fit_failed_percent,
            "ratio": error.planar_fit_deg / error.bound_deg,
            "homography_deg": error.homography_deg,
            "homography_over_15_deg_percent": error.homography_gross_percent,
        }
        rows.append({"method": "theta_bound", "case": f"{error.distance_m:g} m", "metrics": metrics})
    for case in CASES:
        rates = identification_rates(robots, case, trials, seed=0)
        rows.append({"method": "identification", "case": case.name, "metrics": rates})
    results = {
        "experiment": "perception",
        "settings": configuration(robots),
        "seeds": seeds,
        "sigma_px": REFERENCE_SIGMA_PX,
        "rows": rows,
    }
    written = write_json(out / "results.json", results)
    (out / "perception.md").write_text(_markdown(rows), encoding="utf-8")
    return written


def scene_metrics(approaches: Sequence[Sequence[Look]]) -> dict[str, Any]:
    """Counts over all approaches of one scene.

    A frame counts as valid if it showed the array itself. ``losses`` are invalid stretches longer than 100 ms after
    the first lock, and approaches without any lock; ``losses_leds_visible`` those that began with three LEDs or more
    in sight; ``ambiguous_percent`` frames in which the array could not be told from another; ``late_flags`` valid
    frames that use LEDs nobody could see; ``relock_max_s`` the longest time from LEDs in sight again to the next
    valid frame.
    """
    locks = [_first_lock(looks) for looks in approaches]
    gaps = [gap for looks, lock in zip(approaches, locks, strict=True) for gap in _gaps(looks, lock)]
    never = [looks for looks, lock in zip(approaches, locks, strict=True) if lock is None]
    relocks = [(visible_frames - 1) / RATE_HZ for _, visible_frames, length in gaps if length > _LOSS_FRAMES]
    every = [look for looks in approaches for look in looks]
    found = [lock / RATE_HZ for lock in locks if lock is not None]
    return {
        "frames": len(every),
        "valid_percent": 100.0 * sum(look.measured for look in every) / len(every),
        "never_locked": len(never),
        "lock_median_s": float(np.median(found)) if found else None,
        "lock_max_s": max(found, default=None),
        "losses": sum(length > _LOSS_FRAMES for _, _, length in gaps) + len(never),
        "losses_leds_visible": sum(length > _LOSS_FRAMES and begun for begun, _, length in gaps)
        + sum(int(looks[0].visible.sum()) >= _ENOUGH_LEDS for looks in never),
        "ambiguous_percent": 100.0 * sum(look.detection.cause == "ambiguous" for look in every) / len(every),
        "relock_max_s": max(relocks, default=0.0),
        "late_flags": sum(look.detection.leds_seen > int(look.visible.sum()) for look in every if look.measured),
        "wrong_led_frames": sum(look.measured and look.wrong_leds > 0 for look in every),
        "false_locks": sum(look.false_lock for look in every),
    }


def _first_lock(looks: Sequence[Look]) -> int | None:
    return next((row for row, look in enumerate(looks) if look.measured), None)


def _gaps(looks: Sequence[Look], lock: int | None) -> list[tuple[bool, int, int]]:
    """Invalid stretches: whether enough LEDs were in sight as it began, frames in sight at its end, its length."""
    gaps = []
    start: int | None = None
    for row in range(lock if lock is not None else len(looks), len(looks)):
        valid = looks[row].measured
        if not valid and start is None:
            start = row
        if start is not None and (valid or row == len(looks) - 1):
            in_sight = [int(look.visible.sum()) >= _ENOUGH_LEDS for look in looks[start : row + 1]]
            tail = in_sight[::-1].index(False) if False in in_sight else len(in_sight)
            gaps.append((in_sight[0], tail, row - start))
            start = None
    return gaps


def _band_rows(config: Config, name: str, approaches: Sequence[Sequence[Look]]) -> list[Row]:
    rows: list[Row] = []
    for far, near in BANDS_M:
        looks = [
            look for looks in approaches for look in looks if look.measured and near <= look.view.relative.x_m < far
        ]
        if not looks:
            continue
        rows.append({"method": "pose", "case": f"{name} {far:g}–{near:g} m", "metrics": _pose_metrics(config, looks)})
    return rows


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
    return {
        "frames": len(looks),
        "sigma_px": sigma_px,
        "x_rms_cm": 100.0 * _rms(filtered[:, 0]),
        "y_rms_cm": 100.0 * _rms(filtered[:, 1]),
        "theta_rms_deg": math.degrees(_rms(filtered[:, 2])),
        "fit_x_rms_cm": 100.0 * _rms(fit[:, 0]),
        "fit_y_rms_cm": 100.0 * _rms(fit[:, 1]),
        "fit_theta_rms_deg": math.degrees(_rms(fit[:, 2])),
        "theta_homography_rms_deg": math.degrees(_rms(np.array(decomposed))) if decomposed else None,
        "x_bound_cm": 100.0 * float(bound[0]),
        "y_bound_cm": 100.0 * float(bound[1]),
        "theta_bound_deg": math.degrees(bound[2]),
    }


def _fit(look: Look) -> tuple[float, float, float]:
    if look.detection.fit is None:
        raise ValueError(f"frame {look.view.frame_sequence} is valid without a fit")
    return look.detection.fit[:3]


def _rms(values: np.ndarray[Any, np.dtype[np.float64]]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _write_picture(path: Path, optics: Optics, config: Config, look: Look) -> None:
    """The frame again, brightened, with the truth as circles and what was detected as crosses."""
    image: Image = np.zeros((config.camera.height_px, config.camera.width_px), np.uint8)
    optics.render(image, look.view)
    canvas = cv2.cvtColor(cv2.convertScaleAbs(image, alpha=1.5), cv2.COLOR_GRAY2BGR)
    for u, v in np.rint(look.leds_px).astype(int):
        cv2.circle(canvas, (int(u), int(v)), 14, (90, 90, 255), 1, cv2.LINE_AA)
    pixels = features_px(config, look.detection)
    for led, (u, v) in enumerate(pixels):
        if np.isfinite(u):
            at = (round(float(u)), round(float(v)))
            cv2.drawMarker(canvas, at, (80, 255, 80), cv2.MARKER_CROSS, 22, 1, cv2.LINE_AA)
            cv2.putText(canvas, str(led), (at[0] + 12, at[1] - 8), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (80, 255, 80), 1)
    seconds = look.view.frame_sequence * PERIOD_NS * 1e-9
    text = f"{look.view.scene.name}  {seconds:.2f} s  {look.view.relative.x_m:.2f} m  {look.detection.cause}"
    cv2.putText(canvas, text, (16, 36), cv2.FONT_HERSHEY_SIMPLEX, 0.8, (255, 255, 255), 1, cv2.LINE_AA)
    if not cv2.imwrite(str(path), canvas):
        raise OSError(f"{path}: picture could not be written")


def _markdown(rows: Sequence[Row]) -> str:
    """One table per kind of row."""
    parts = []
    for kind in dict.fromkeys(row["method"] for row in rows):
        chosen = [row for row in rows if row["method"] == kind]
        names = list(chosen[0]["metrics"])
        parts.append(f"| {kind} | " + " | ".join(names) + " |\n|---|" + "---:|" * len(names))
        parts += [
            f"| {row['case']} | " + " | ".join(_cell(row["metrics"][name]) for name in names) + " |" for row in chosen
        ]
        parts.append("")
    return "\n".join(parts) + "\n"


def _cell(value: float | None) -> str:
    return "–" if value is None else f"{value:.4g}"
