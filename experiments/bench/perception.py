"""``davpc bench perception``: what each way of finding the array costs, side by side in one run, in one thread.

Two floors: ``plain_read`` copies the frame, read and write, which the estimator does with each frame of the ring;
``plain_max`` only reads it. ``tracked`` is the search of spots in the predicted regions alone; ``pipeline`` is all
of perception from frame to both poses, without lamps and among them. ``identify`` takes another layout each time.
Beside our own paths stand what one would use instead on the same frame: connected components, a blob detector,
AprilTag and ArUco markers on a bright textured frame. ``run`` writes ``results.json`` (rows of method, case = number
of spots, metrics) and ``bench.md``; a 99th percentile is given for a hundred samples or more.
"""

from __future__ import annotations

import itertools
import math
import os
import platform
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from common.config import Config, default_config_path, load_config
from common.files.writer import write_json
from common.frames.ring import Image
from common.geometry import Array, Pose2, features_at, move_relative
from experiments.perception.approach import PERIOD_NS
from experiments.shared.results import configuration
from experiments.shared.steady import steady
from follower.estimator.identity.identification import Identifier, Limits
from follower.estimator.lens import Lens
from follower.estimator.pipeline import Perception
from follower.estimator.planar_fit import FitModel
from follower.estimator.single_fit import fit_one
from follower.estimator.spots import SpotRule, find_spots, find_spots_near
from follower.paper.homography import array_normal, theta_from_homography
from sim.optics.image import Optics, View
from sim.optics.scenes import Lamp, Scene

POSE = Pose2(5.0, 0.4, 0.1)
CLUTTER = (0, 10, 20, 30, 40)
SPOTS = 24
PIPELINE_LAMPS = 20
_REGION_HALF_PX = 20
_NOISE_PX = 0.05
_SAMPLES_FOR_P99 = 100
_LAYOUTS = 25
Work = Callable[[], object]
Timed = tuple[str, int, float, float | None, int]  # method, case, median, 99th percentile [ms], samples


def run(out: Path, config: Config | None = None, rounds: int = 200) -> dict[str, Any]:
    """Measure every path.

    Args:
        out: folder for the results; made if missing.
        config: the robots; None: the default configuration.
        rounds: measurements per path; the slow ones take a tenth of them.
    """
    robots = steady(config if config is not None else load_config(default_config_path()))
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        works = _frame_works(robots) + _identify_works(robots) + _pose_works(robots)
        works += [_pipeline_work(robots, lamps) for lamps in (0, PIPELINE_LAMPS)]
        timed = _interleaved(works, rounds) + _interleaved(_other_works(robots), max(rounds // 10, 5))
    finally:
        cv2.setNumThreads(threads)
    copied, read = (next(row[2] for row in timed if row[0] == floor) for floor in ("plain_read", "plain_max"))
    rows = [
        {
            "method": method,
            "case": case,
            "metrics": {
                "median_ms": median,
                "p99_ms": p99,
                "samples": samples,
                "times_plain_read": median / copied,
                "times_plain_max": median / read,
            },
        }
        for method, case, median, p99, samples in timed
    ]
    machine = {"cores": os.cpu_count(), "system": platform.system(), "python": platform.python_version()}
    results = {"bench": "perception", "settings": configuration(robots), "machine": machine, "rows": rows}
    out.mkdir(parents=True, exist_ok=True)
    written = write_json(out / "results.json", results)
    (out / "bench.md").write_text(_markdown(rows), encoding="utf-8")
    return written


def _interleaved(works: list[tuple[str, int, Work]], rounds: int) -> list[Timed]:
    """Times of each, taken in turn so that all meet the same disturbances."""
    taken: list[list[float]] = [[] for _ in works]
    for _ in range(rounds):
        for (_, _, work), times in zip(works, taken, strict=True):
            begin = time.perf_counter()
            work()
            times.append(1e3 * (time.perf_counter() - begin))
    return [
        (method, case, float(np.median(times)), _p99(times), len(times))
        for (method, case, _), times in zip(works, taken, strict=True)
    ]


def _p99(times: list[float]) -> float | None:
    """None for so few samples that it would be their maximum."""
    return float(np.percentile(times, 99)) if len(times) >= _SAMPLES_FOR_P99 else None


def _frame_works(config: Config) -> list[tuple[str, int, Work]]:
    image = spotted_frame(config, SPOTS - len(config.leds.points))
    rule = SpotRule(round(config.estimator.threshold / 2), config.estimator.min_spot_px, config.estimator.max_spot_px)
    predicted = config.camera.pinhole.to_pixels(features_at(config.leds.points, POSE, config.camera.mount))
    return [
        ("plain_read", SPOTS, image.copy),
        ("plain_max", SPOTS, image.max),
        ("whole_frame", SPOTS, lambda: find_spots(image, rule)),
        ("tracked", len(predicted), lambda: find_spots_near(image, predicted, _REGION_HALF_PX, rule)),
    ]


def _identify_works(config: Config) -> list[tuple[str, int, Work]]:
    model = _model(config)
    identifier = Identifier(model, Limits())
    works: list[tuple[str, int, Work]] = []
    for count in CLUTTER:
        layouts = itertools.cycle([_layout(config, count, number) for number in range(_LAYOUTS)])
        works.append(("identify", count, _bound(_identify_next, identifier, layouts)))
    return works


def _identify_next(identifier: Identifier, layouts: Iterator[tuple[Array, Array]]) -> object:
    candidates, mass = next(layouts)
    return identifier.identify(candidates, mass, allow_partial=False)


def _layout(config: Config, count: int, number: int) -> tuple[Array, Array]:
    """The array's features and ``count`` others (n, 2), with the masses (n,) of all."""
    draws = np.random.default_rng((count, number))
    clutter = np.column_stack([draws.uniform(-1.5, 1.5, count), draws.uniform(-0.8, 0.3, count)])
    candidates = np.vstack([_noisy_features(config, draws), clutter])
    return candidates, draws.uniform(300.0, 600.0, len(candidates))


def _pose_works(config: Config) -> list[tuple[str, int, Work]]:
    features = _noisy_features(config, np.random.default_rng(0))
    leds = len(features)
    desired = features_at(config.leds.points, config.docking.goal(1), config.camera.mount)
    start = np.array([*POSE.as_array() + 0.01, 0.0, 0.0])
    identity, none = np.eye(3), np.zeros(0)
    points = np.ascontiguousarray(config.leds.points)
    return [
        ("planar_fit", leds, _bound(fit_one, _model(config), features, start)),
        (
            "homography",
            leds,
            _bound(theta_from_homography, features, desired, array_normal(config.leds.points), 0.1),
        ),
        (
            "sqpnp",
            leds,
            lambda: cv2.solvePnP(points, features, identity, none, flags=cv2.SOLVEPNP_SQPNP),
        ),
    ]


def _pipeline_work(config: Config, lamps: int) -> tuple[str, int, Work]:
    """The whole of it over a short approach, rendered beforehand: lock, then tracked frames."""
    scene = _lamps(lamps)
    optics = Optics(config.camera, config.leds, seed=2)
    perception, twist = Perception(config), (0.3, 0.05)
    frames: list[Image] = []
    pose = POSE
    for sequence in range(24):
        frames.append(_rendered(config, optics, View(sequence, pose, _currents(config), scene=scene)))
        pose = move_relative(pose, *twist, 1e-9 * PERIOD_NS)
    there_and_back = frames + frames[-2:0:-1]
    shown = 0

    def step() -> object:
        nonlocal shown
        shown += 1
        forward = (shown - 1) % len(there_and_back) < len(frames) - 1
        driven = twist if forward else (-twist[0], -twist[1])
        image = there_and_back[shown % len(there_and_back)]
        return perception.process(image, shown, shown * PERIOD_NS, driven)

    for _ in range(8):
        step()
    return "pipeline", len(config.leds.points) + lamps, step


def _other_works(config: Config) -> list[tuple[str, int, Work]]:
    dim = spotted_frame(config, SPOTS - len(config.leds.points))
    bright = textured_frame(config)
    blobs = cv2.SimpleBlobDetector.create(_blob_parameters())
    _, mask = cv2.threshold(dim, 20, 255, cv2.THRESH_BINARY)
    tags = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11))
    markers = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))
    return [
        ("connected_components", SPOTS, lambda: cv2.connectedComponentsWithStats(mask, connectivity=8)),
        ("simple_blob_detector", SPOTS, lambda: blobs.detect(dim)),
        ("aruco_36h11", 0, lambda: tags.detectMarkers(bright)),
        ("aruco_4x4_50", 0, lambda: markers.detectMarkers(bright)),
        ("aruco_36h11_dark", SPOTS, lambda: tags.detectMarkers(dim)),
    ]


def spotted_frame(config: Config, clutter: int) -> Image:
    """A rendered frame with the array and ``clutter`` lamps."""
    optics = Optics(config.camera, config.leds, seed=2)
    return _rendered(config, optics, View(1, POSE, _currents(config), scene=_lamps(clutter)))


def _lamps(count: int) -> Scene:
    draws = np.random.default_rng(count)
    lamps = tuple(
        Lamp((6.0, float(y), float(draws.uniform(2.6, 4.5))), float(draws.uniform(8e3, 4e4)))
        for y in np.linspace(-6.0, 6.0, count)
    )
    return Scene("bench", lamps=lamps)


def textured_frame(config: Config) -> Image:
    """A bright frame with structure at several scales, as a camera without the filter sees a hall."""
    draws = np.random.default_rng(3)
    height, width = config.camera.height_px, config.camera.width_px
    sum_of_scales = np.zeros((height, width), np.float32)
    for cells in (8, 32, 128):
        coarse = draws.uniform(0.0, 1.0, (cells, cells)).astype(np.float32)
        sum_of_scales += cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    image: Image = np.clip(60.0 + 50.0 * sum_of_scales + draws.normal(0, 2, (height, width)), 0, 255).astype(np.uint8)
    return image


def _rendered(config: Config, optics: Optics, view: View) -> Image:
    image: Image = np.zeros((config.camera.height_px, config.camera.width_px), np.uint8)
    optics.render(image, view)
    return image


def _currents(config: Config) -> tuple[float, ...]:
    return (config.leds.current_a,) * len(config.leds.points)


def _model(config: Config) -> FitModel:
    sigma = config.estimator.pixel_sigma_px / config.camera.lens.fx_px
    return FitModel(config.leds.points, config.camera.mount, sigma, math.radians(0.7))


def _noisy_features(config: Config, draws: np.random.Generator) -> Array:
    """Features through the lens and back, with centroid noise."""
    lens = Lens(config.camera)
    pixels = lens.to_pixels(features_at(config.leds.points, POSE, config.camera.mount))
    return lens.to_normalised(pixels + draws.normal(0.0, _NOISE_PX, pixels.shape))


def _blob_parameters() -> cv2.SimpleBlobDetector.Params:
    parameters = cv2.SimpleBlobDetector.Params()
    parameters.filterByColor, parameters.blobColor = True, 255
    parameters.filterByArea, parameters.minArea = True, 2.0
    parameters.filterByCircularity = parameters.filterByConvexity = parameters.filterByInertia = False
    parameters.minThreshold, parameters.maxThreshold, parameters.thresholdStep = 20.0, 60.0, 20.0
    parameters.minRepeatability = 1
    return parameters


def _bound(function: Callable[..., object], *arguments: object) -> Work:
    return lambda: function(*arguments)


def _markdown(rows: list[dict[str, Any]]) -> str:
    lines = [
        "| method | spots | median ms | p99 ms | samples | × copy | × read |",
        "|---|---:|---:|---:|---:|---:|---:|",
    ]
    for row in rows:
        metrics = row["metrics"]
        p99 = "–" if metrics["p99_ms"] is None else f"{metrics['p99_ms']:.3f}"
        lines.append(
            f"| {row['method']} | {row['case']} | {metrics['median_ms']:.3f} | {p99} | {metrics['samples']} "
            f"| {metrics['times_plain_read']:.1f} | {metrics['times_plain_max']:.1f} |"
        )
    return "\n".join(lines) + "\n"
