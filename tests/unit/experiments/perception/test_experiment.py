"""What `davpc experiment perception` and `davpc bench perception` write."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from itertools import islice
from pathlib import Path

import pytest

from common.config import CameraConfig, Config
from common.geometry import Pose2, features_at
from experiments.bench import perception as bench_perception
from experiments.perception import experiment as perception
from experiments.perception.approach import approach, wrong_leds
from experiments.perception.identification import CASES, LampCase, identification_rates
from experiments.perception.pose_bound import pose_bound, theta_errors
from experiments.perception.scene_counts import BANDS_M, band_metrics, scene_metrics
from experiments.shared.steady import steady
from follower.estimator.state import StateEstimator
from sim.optics.image import Optics, View
from sim.optics.scenes import Scene, SecondArray, Walker


@pytest.mark.parametrize("distance_m", [1.5, 3.0, 6.0, 9.0])
def test_default_route_is_near_the_bound(config: Config, distance_m: float) -> None:
    (error,) = theta_errors(config, (distance_m,), 0.2, trials=400, seed=1)
    assert error.planar_fit_deg <= 1.3 * error.bound_deg
    assert error.planar_fit_failed_percent == 0.0
    assert error.homography_deg > error.bound_deg


def test_bound_grows_with_distance_and_noise(config: Config) -> None:
    near = pose_bound(config, Pose2(3.0, 0.0, 0.0), 0.2)
    far = pose_bound(config, Pose2(6.0, 0.0, 0.0), 0.2)
    assert (far > near).all()
    assert pose_bound(config, Pose2(3.0, 0.0, 0.0), 0.4) == pytest.approx(2 * near)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_identification_is_rather_silent_than_wrong(config: Config, case: LampCase) -> None:
    rates = identification_rates(config, case, frames=30, seed=3)
    assert rates["false_percent"] == 0.0
    if case.leds_lit and case.lamps == 0:
        assert rates["right_percent"] > 85.0
    if not case.leds_lit:
        assert rates["silent_percent"] == 100.0


def test_experiment_writes_rows_table_and_picture(config: Config, tmp_path: Path) -> None:
    results = perception.run(tmp_path, config, seeds=1, scenes=("clean",), trials=20)
    assert json.loads((tmp_path / "results.json").read_text()) == results
    scene = results["rows"][0]
    assert (scene["method"], scene["case"]) == ("davpc", "clean")
    assert scene["metrics"]["losses"] == scene["metrics"]["wrong_led_frames"] == 0
    bands = [row for row in results["rows"] if row["method"] == "band"]
    assert len(bands) == 4
    for metrics in (row["metrics"] for row in bands):
        assert 0.5 < metrics["fit_theta_rms_deg"] / metrics["theta_bound_deg"] < 2.0, "at the frames' own noise"
        assert metrics["theta_rms_deg"] < metrics["fit_theta_rms_deg"], "the observer filters"
        assert metrics["losses"] == metrics["wrong_led_frames"] == metrics["false_locks"] == 0
    assert [row["metrics"]["locks"] for row in bands] == [1, 0, 0, 0]
    dark = [row["metrics"] for row in results["rows"] if row["method"] == "no_led"]
    assert len(dark) == 2
    assert all(metrics["frames"] >= 300 and metrics["false_lock_percent"] <= 0.1 for metrics in dark)
    assert all(metrics["confirmed"] == 0 for metrics in dark)
    assert "| clean |" in (tmp_path / "perception.md").read_text()
    assert (tmp_path / "scene_clean.png").stat().st_size > 1000


def test_an_approach_that_never_locks_is_a_loss_and_results_stay_json(config: Config) -> None:
    optics = Optics(config.camera, config.leds, seed=1)
    scene = Scene(others=(SecondArray(Pose2(0.5, 2.0, 0.1)),))
    seen = list(islice(approach(config, optics, StateEstimator(steady(config)), scene, 0), 20))
    counted = scene_metrics([seen])
    assert counted["never_locked"] == counted["losses"] == counted["losses_leds_visible"] == 1
    assert counted["ambiguous_percent"] == 100.0
    json.dumps(counted, allow_nan=False)


def test_features_are_judged_through_the_whole_lens(config: Config) -> None:
    bent = {**config.camera.lens.model_dump(), "model": "rational", "coefficients": (-0.6, 0.2, *(0.0,) * 6)}
    camera = CameraConfig.model_validate({**config.camera.model_dump(), "lens": bent})
    robots = config.model_copy(update={"camera": camera})
    near = Pose2(1.8, 0.5, 0.2)
    leds_px, _ = Optics(camera, config.leds, seed=1).led_truth(View(1, near, (1.0,) * 4))
    features = tuple((float(a), float(b)) for a, b in features_at(config.leds.points, near, camera.mount))
    state = replace(StateEstimator(robots).no_frame(0, (0.0, 0.0)), features=(None, *features[1:]))
    assert wrong_leds(robots, state, leds_px) == 0
    assert wrong_leds(config, state, leds_px) == 3, "another lens puts them elsewhere"


def test_bench_writes_every_method(config: Config, tmp_path: Path) -> None:
    results = bench_perception.run(tmp_path, config, rounds=2)
    assert json.loads((tmp_path / "results.json").read_text()) == results
    methods = {row["method"] for row in results["rows"]}
    assert {"plain_read", "plain_max", "whole_frame", "tracked", "identify", "pipeline", "aruco_36h11"} <= methods
    assert {row["case"] for row in results["rows"] if row["method"] == "identify"} == {0, 10, 20, 30, 40}
    assert {row["case"] for row in results["rows"] if row["method"] == "pipeline"} == {4, 24}
    assert all(math.isfinite(row["metrics"]["median_ms"]) for row in results["rows"])
    assert all(row["metrics"]["p99_ms"] is None for row in results["rows"]), "two samples have no 99th percentile"
    assert "| tracked | 4 |" in (tmp_path / "bench.md").read_text()


def test_a_loss_is_counted_where_it_happened(config: Config) -> None:
    optics = Optics(config.camera, config.leds, seed=1)
    scene = Scene(walkers=(Walker((-1.0, -1.6), (0.0, 1.4), 0.8),))
    seen = list(islice(approach(config, optics, StateEstimator(steady(config)), scene, 1), 300))
    counts = [band_metrics(config, [seen], far, near) for far, near in BANDS_M]
    assert sum(row["losses"] or 0 for row in counts) == scene_metrics([seen])["losses"]
    assert counts[0]["locks"] == 1
    assert counts[0]["losses"]
    assert counts[0]["relock_max_s"] is not None
    assert counts[3]["frames"] == 0
    assert counts[3]["theta_rms_deg"] is None
