"""``davpc experiment perception``: named scenes, 8 → 1.5 m, and both routes to the pose beside the bound.

``run`` writes ``results.json`` (rows of method, case, metrics), ``perception.md`` and one picture a scene with the
detections drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from common.config import Config, default_config_path, load_config
from common.files.writer import write_json
from common.frames.ring import Image
from experiments.perception.approach import PERIOD_NS, Look, approach, features_px, stand, steer
from experiments.perception.identification import CASES, identification_rates
from experiments.perception.pose_bound import theta_errors
from experiments.perception.scene_counts import BANDS_M, band_metrics, scene_metrics
from experiments.shared.executor import ALONE, Workers, run_all
from experiments.shared.results import configuration
from experiments.shared.steady import steady
from follower.estimator.state import StateEstimator
from sim.optics.image import Optics
from sim.optics.scenes import SCENES as SCENES
from sim.optics.scenes import named_scene

BOUND_DISTANCES_M = (1.5, 3.0, 6.0, 9.0)
REFERENCE_SIGMA_PX = 0.2
STANDING_FRAMES = 300
Row = dict[str, Any]


@dataclass(frozen=True)
class LookJob:
    """One approach: the scene's name, the seed, whether the array is lit and the robot drives; the configuration
    as JSON.
    """

    scene: str
    seed: int
    config_text: str
    lit: bool = True
    drives: bool = True


def look_job(job: LookJob) -> list[Look]:
    """Every frame of one approach."""
    config = Config.model_validate_json(job.config_text)
    optics = Optics(config.camera, config.leds, seed=1)
    scene = replace(named_scene(job.scene, job.seed), leds_lit=job.lit)
    drive, frames = (steer, None) if job.drives else (stand, STANDING_FRAMES)
    return list(
        islice(approach(config, optics, StateEstimator(_with_homography(config)), scene, job.seed, drive), frames)
    )


def _with_homography(config: Config) -> Config:
    """The same, with θ of the homography in every state, as the paper's controller would read it."""
    controller = config.controller.model_copy(update={"method": "paper_fatrop"})
    return config.model_copy(update={"controller": controller})


def run(
    out: Path,
    config: Config | None = None,
    seeds: int = 20,
    scenes: Sequence[str] = tuple(SCENES),
    trials: int = 1000,
    workers: Workers = ALONE,
) -> dict[str, Any]:
    """Run every scene with every seed and write what came of it.

    Args:
        out: folder for the results; made if missing.
        config: the robots; None: the default configuration.
        seeds: approaches per scene.
        scenes: names from :data:`sim.optics.scenes.SCENES`.
        trials: noisy images per distance of the comparison with the bound, and random scenes per case of
            identification.
        workers: who does the runs; they change nothing but the time.
    """
    robots = steady(config if config is not None else load_config(default_config_path()))
    out.mkdir(parents=True, exist_ok=True)
    optics = Optics(robots.camera, robots.leds, seed=1)
    text = robots.model_dump_json()
    rows: list[Row] = []
    for name in scenes:
        looks = run_all(look_job, [LookJob(name, seed, text) for seed in range(seeds)], workers, name)
        rows.append({"method": robots.estimator.method, "case": name, "metrics": scene_metrics(looks)})
        rows += _band_rows(robots, name, looks)
        _write_picture(out / f"scene_{name}.png", optics, robots, looks[0][len(looks[0]) // 3])
    rows += _dark_rows(text, seeds, workers) + _bound_rows(robots, trials) + _identification_rows(robots, trials)
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


def _band_rows(config: Config, name: str, looks: Sequence[Sequence[Look]]) -> list[Row]:
    return [
        {"method": "band", "case": f"{name} {far:g}–{near:g} m", "metrics": band_metrics(config, looks, far, near)}
        for far, near in BANDS_M
    ]


def _dark_rows(config_text: str, seeds: int, workers: Workers) -> list[Row]:
    """Forty lamps and no LED: frames in which some are taken for the array at all, and such as are confirmed."""
    rows: list[Row] = []
    for case, drives in (("40 lamps, driving", True), ("40 lamps, standing", False)):
        todo = [LookJob("clutter40", seed, config_text, lit=False, drives=drives) for seed in range(seeds)]
        looks = [look for looks in run_all(look_job, todo, workers, f"no LED, {case}") for look in looks]
        taken = sum(look.detection.leds_seen > 0 for look in looks)
        metrics = {
            "frames": len(looks),
            "false_locks": taken,
            "false_lock_percent": 100.0 * taken / len(looks),
            "confirmed": sum(look.detection.valid for look in looks),
        }
        rows.append({"method": "no_led", "case": case, "metrics": metrics})
    return rows


def _bound_rows(config: Config, trials: int) -> list[Row]:
    rows: list[Row] = []
    for error in theta_errors(config, BOUND_DISTANCES_M, REFERENCE_SIGMA_PX, trials, seed=0):
        metrics = {
            "bound_deg": error.bound_deg,
            "planar_fit_deg": error.planar_fit_deg,
            "planar_fit_failed_percent": error.planar_fit_failed_percent,
            "ratio": error.planar_fit_deg / error.bound_deg,
            "homography_deg": error.homography_deg,
            "homography_over_15_deg_percent": error.homography_gross_percent,
        }
        rows.append({"method": "theta_bound", "case": f"{error.distance_m:g} m", "metrics": metrics})
    return rows


def _identification_rows(config: Config, trials: int) -> list[Row]:
    return [
        {"method": "identification", "case": case.name, "metrics": identification_rates(config, case, trials, seed=0)}
        for case in CASES
    ]


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
