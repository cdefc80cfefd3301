"""Whole dockings of both robots by ``davpc sim --stepped``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tests.rigs.sim_run import is_docked
from tests.rigs.station_rig import davpc_in_process

NEAR = "2.0,0.05,1"


def test_stepped_dockings_are_bit_identical(sim_run: Any) -> None:
    near = ("--stepped", "--start", NEAR)
    first, second = sim_run(*near), sim_run(*near)
    assert (first.finish(), second.finish()) == (0, 0), "".join(first.lines)
    assert is_docked(first.results()), first.results()
    assert (first.out / "results.json").read_bytes() == (second.out / "results.json").read_bytes()
    assert (first.out / "camera_frame.png").read_bytes() == (second.out / "camera_frame.png").read_bytes()
    holds_what_programs_rely_on(first.results())


def holds_what_programs_rely_on(results: dict[str, Any]) -> None:
    assert set(results["metrics"]) == {"e_x_cm", "e_y_cm", "e_theta_deg", "e_p_px", "m_v", "m_w", "duration_s"}
    assert set(results["frames"]) == {"seen", "dropped"}
    assert set(results["image_to_can_ms"]) == {"p50", "p99"}
    assert all(isinstance(value, float) for value in results["metrics"].values())


def test_a_stepped_queue_of_two_is_docked_and_counted(sim_run: Any) -> None:
    run = sim_run("--stepped", "--trolleys", "2", "--start", NEAR)
    assert run.finish() == 0, "".join(run.lines)
    results = run.results()
    assert results["connected"]
    assert [row["trolley"] for row in results["trolleys"]] == [1, 2]
    assert all(is_docked(row) for row in results["trolleys"]), results
    assert "staging" in results["trolleys"][1]["phases_s"]
    for picture in ("collection.png", "trajectory-1.png", "trajectory-2.png", "camera_frame-2.png"):
        assert (run.out / picture).stat().st_size > 10_000


def test_the_papers_estimator_docks_too(sim_run: Any) -> None:
    run = sim_run("--stepped", "--start", NEAR, "--set", "estimator.method='paper'")
    assert run.finish() == 0, "".join(run.lines)
    assert is_docked(run.results()), run.results()


def test_an_exposure_too_short_is_mended_by_the_retry(sim_run: Any) -> None:
    run = sim_run("--stepped", "--start", "4.5,0.1,2", "--set", "camera.exposure_us=20.0")
    assert run.finish() == 0, "".join(run.lines)
    assert is_docked(run.results()), run.results()
    assert any("exposure 80 µs after 20 µs" in line for line in run.lines)


def test_leds_out_of_view_end_by_name_with_results(sim_run: Any) -> None:
    run = sim_run("--stepped", "--start", "3,0,180", "--set", "supervisor.search_turn_deg=5.0")
    assert run.finish() == 1, "".join(run.lines)
    results = run.results()
    assert results["cause"] == "leds_lost: 3 searches"
    assert results["metrics"]["e_p_px"] is None
    assert not any("Traceback" in line for line in run.lines)


def test_a_missing_device_is_one_line_and_exit_code_3(tmp_path: Path) -> None:
    camera = ("--set", "camera.driver='v4l2'", "--set", "camera.device='/dev/video99'")
    ended = davpc_in_process("sim", "--headless", "--stepped", "--out", str(tmp_path), *camera)
    assert ended.returncode == 3, ended
    assert sum(line.startswith("davpc:") for line in ended.stderr.splitlines()) == 1
