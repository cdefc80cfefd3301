"""What `davpc experiment tolerance` draws, counts and writes."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from common.config import Config
from common.docking_errors import DockingError
from experiments.shared.executor import ALONE
from experiments.tolerance.docking import ApproachEnd
from experiments.tolerance.experiment import LATER, groups, is_docked, metrics_of, run
from experiments.tolerance.robots import RobotJob, start_of
from sim.truth import Truth


def end(e_y_m: float, cause: str = "") -> ApproachEnd:
    return ApproachEnd(cause, DockingError(e_x_m=0.01, e_y_m=e_y_m, e_theta_rad=math.radians(-0.5)), 20.0, 0.1)


def test_methods_meet_the_same_robots_and_classes_share_their_errors(config: Config) -> None:
    found = {
        (method, case): jobs for method, case, jobs in groups(config, 3, 9, ("geometry", "taught"), ("leds", "all"))
    }
    assert [job.truth for job in found["geometry", "all"]] == [job.truth for job in found["taught", "all"]]
    assert [start_of(job) for job in found["geometry", "all"]] == [start_of(job) for job in found["taught", "leds"]]
    leds = found["geometry", "leds"][4].truth.drawn(4)
    assert leds.leds_m == found["geometry", "all"][4].truth.drawn(4).leds_m
    assert leds.camera_m == (0.0, 0.0, 0.0)
    both = found["taught", "all_trolleys_2_to_8_taught_at_1_and_4"]
    assert [job.trolley for job in both] == [*LATER, 2, 3]
    assert {job.taught for job in both} == {(1, 4)}


def test_what_does_not_arrive_or_lies_beyond_the_bound_is_not_docked(config: Config) -> None:
    jobs = [RobotJob("", "geometry", Truth(), number=i) for i in range(4)]
    ends = [end(0.002), end(-0.004), end(0.08), end(0.0, "no_progress: 3 retries")]
    metrics = metrics_of(config, jobs, ends)
    assert metrics["not_docked"] == 2.0
    assert metrics["e_y_cm"] == pytest.approx((0.2 + 0.4 + 8.0) / 3)
    assert metrics["worst_e_y_cm"] == pytest.approx(8.0)
    assert metrics["e_theta_deg"] == pytest.approx(0.5)
    assert metrics["noticed"] is None
    assert is_docked(config, RobotJob("", "geometry", Truth(), trolley=2), ends[2])  # the guide of a queue is wider
    assert metrics_of(config, jobs[:1], ends[3:])["e_y_cm"] is None


def test_results_table_and_figure(config: Config, tmp_path: Path) -> None:
    run(tmp_path, 1, ALONE, config, robots=1, methods=("geometry",), cases=("latency",), sensitivities=False)
    results = json.loads((tmp_path / "results.json").read_text())
    (row,) = results["rows"]
    assert (row["method"], row["case"], row["n"]) == ("geometry", "latency", 1)
    assert set(row["metrics"]) >= {"e_x_cm", "e_y_cm", "e_theta_deg", "worst_e_y_cm", "not_docked", "noticed"}
    assert row["metrics"]["not_docked"] == 0
    assert (tmp_path / "tolerance.png").stat().st_size > 5_000
