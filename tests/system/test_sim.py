"""Both robots dock a trolley: all processes over Zenoh and CAN, and the same nodes in stepped time."""

from __future__ import annotations

import json
import os
import signal
import time
from pathlib import Path
from typing import Any

import pytest

from common.config import Config
from common.processes import ONE_MACHINE
from tests.system.conftest import CanTap, judged_on_a_calm_host, until

FOLLOWER = [process.name for process in ONE_MACHINE if process.robot == "follower"]
START = ("--start", "3,0.15,3")


def is_docked(results: dict[str, Any]) -> bool:
    metrics = results["metrics"]
    return bool(
        results["connected"]
        and results["cause"] == "docked"
        and metrics["e_y_cm"] <= 2.0
        and metrics["e_theta_deg"] <= 1.0
        and metrics["duration_s"] <= 60.0
    )


def nothing_is_left(runtime: Path, children: dict[str, int]) -> bool:
    return not runtime.exists() and not any(Path(f"/proc/{pid}").exists() for pid in children.values())


@pytest.mark.alone
@judged_on_a_calm_host
def test_a_docking_with_every_process(sim_run: Any) -> None:
    run = sim_run(*START, "--seed", "3")
    run.wait_for("approach")
    children, runtime = run.children(), run.runtime()
    assert set(children) == {process.name for process in ONE_MACHINE}
    assert runtime.stat().st_mode & 0o777 == 0o700
    assert run.finish() == 0, "".join(run.lines)
    results = run.results()
    assert is_docked(results), results
    assert results["frames"]["seen"] > 300
    assert results["image_to_can_ms"]["p50"] > 0
    assert results["settings"]["seed"] == 3
    for picture in ("trajectory.png", "timeseries.png", "camera_frame.png"):
        assert (run.out / picture).stat().st_size > 10_000
    assert nothing_is_left(runtime, children)


def test_stepped_dockings_are_bit_identical(sim_run: Any) -> None:
    nearer = ("--stepped", "--start", "2.4,0.08,2")
    first, second = sim_run(*nearer), sim_run(*nearer)
    assert (first.finish(), second.finish()) == (0, 0), "".join(first.lines)
    assert is_docked(first.results()), first.results()
    assert (first.out / "results.json").read_bytes() == (second.out / "results.json").read_bytes()
    assert (first.out / "camera_frame.png").read_bytes() == (second.out / "camera_frame.png").read_bytes()


def test_a_stepped_queue_of_two_is_docked_and_counted(sim_run: Any) -> None:
    run = sim_run("--stepped", "--trolleys", "2", "--start", "2.4,0.08,2")
    assert run.finish() == 0, "".join(run.lines)
    results = run.results()
    assert results["connected"]
    assert [row["trolley"] for row in results["trolleys"]] == [1, 2]
    assert all(is_docked(row) for row in results["trolleys"]), results
    assert "staging" in results["trolleys"][1]["phases_s"]
    for picture in ("collection.png", "trajectory-1.png", "trajectory-2.png", "camera_frame-2.png"):
        assert (run.out / picture).stat().st_size > 10_000


def test_the_papers_estimator_docks_too(sim_run: Any) -> None:
    run = sim_run("--stepped", "--start", "2.4,0.08,2", "--set", "estimator.method='paper'")
    assert run.finish() == 0, "".join(run.lines)
    assert is_docked(run.results()), run.results()


def test_an_exposure_too_short_is_mended_by_the_retry(sim_run: Any) -> None:
    run = sim_run("--stepped", "--start", "4.5,0.1,2", "--set", "camera.exposure_us=15.0")
    assert run.finish() == 0, "".join(run.lines)
    assert is_docked(run.results()), run.results()
    assert any("exposure 60 µs after 15 µs" in line for line in run.lines)


@pytest.mark.alone
@pytest.mark.parametrize("victim", FOLLOWER)
def test_a_killed_follower_process_stops_the_wheels_and_is_named(sim_run: Any, config: Config, victim: str) -> None:
    run = sim_run("--start", "5,0.3,0")
    run.wait_for("approach")
    children, runtime = run.children(), run.runtime()
    wheels = (config.follower_can.left_wheel.node_id, config.follower_can.right_wheel.node_id)
    tap = CanTap(run, wheels)
    until(lambda: any(target for _, _, target in tap.targets), 20)
    killed_s = time.monotonic()
    os.kill(children[victim], signal.SIGKILL)
    assert run.finish() == 1
    tap.close()
    results = run.results()
    assert not results["connected"]
    assert results["cause"] == f"process {victim} died (SIGKILL)"
    if victim == "follower-can-bridge":
        # nobody is left to send a frame: the drives' own watchdogs stop the wheels and say so
        noticed = [
            min(at for at, node, code in tap.emergencies if at > killed_s and node == wheel and code)
            for wheel in wheels
        ]
        stopped_s = max(noticed)
    else:
        moving = [at for at, _, target in tap.targets if at > killed_s and target]
        stopped_s = max([killed_s, *moving])
        assert any(at > stopped_s and not target for at, _, target in tap.targets)
    assert stopped_s - killed_s <= 0.250
    assert nothing_is_left(runtime, children)


@pytest.mark.alone
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_run_leaves_nothing(sim_run: Any, number: signal.Signals) -> None:
    run = sim_run("--start", "5,0.3,0")
    run.wait_for("approach")
    children, runtime = run.children(), run.runtime()
    run.process.send_signal(number)
    assert run.finish(30) == 1
    assert run.results()["cause"] == "interrupted"
    assert nothing_is_left(runtime, children)


@pytest.mark.alone
def test_a_killed_launcher_takes_its_processes_with_it(sim_run: Any) -> None:
    run = sim_run("--start", "5,0.3,0")
    run.wait_for("approach")
    children, runtime = run.children(), run.runtime()
    run.process.kill()
    until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in children.values()), 20)
    run.process.wait()
    # its directory stays until the next run finds nobody who owns it
    assert sim_run("--stepped", "--start", "2.2,0,0").finish() == 0
    assert not runtime.exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--set", "camera.exposre_us=1"), "camera.exposre_us: unknown key"),
        (("--set", "camera.gain=-1.0"), "camera.gain"),
        (("--set", "world.wheel_lagg_s=1.0"), "wheel_lagg_s: unknown key"),
        (("--set", "camera.driver='nikon'"), "camera.driver"),
        (("--set", "controller.method='magic'"), "controller.method"),
        (("--config", "absent.toml"), "absent.toml: cannot be read"),
        (("--start", "6,1"), "write 3 numbers"),
        (("--start", "1.2,0,0"), "would stand in the Leader"),
        (("--out", "/proc/nope"), "--out /proc/nope"),
        (("--attach", "/proc/nope"), "--attach /proc/nope: no robot runs here"),
        (("--set", "supervisor.approach_speed_m_s=5.0"), "supervisor.approach_speed_m_s"),
        (("--set", "camera.rate_hz=20.0"), "three frame periods"),
    ],
)
def test_a_users_mistake_is_one_line_and_exit_code_2(sim_run: Any, arguments: tuple[str, ...], said: str) -> None:
    run = sim_run(*arguments)
    assert run.finish(30) == 2
    complaints = [line for line in run.lines if line.startswith("davpc:")]
    assert len(complaints) == 1
    assert said in complaints[0]
    assert not any("Traceback" in line for line in run.lines)


def test_leds_out_of_view_end_by_name_with_results(sim_run: Any) -> None:
    run = sim_run("--stepped", "--start", "3,0,180", "--set", "supervisor.search_turn_deg=5.0")
    assert run.finish() == 1, "".join(run.lines)
    results = run.results()
    assert results["cause"] == "leds_lost: 3 searches"
    assert results["metrics"]["e_p_px"] is None
    assert not any("Traceback" in line for line in run.lines)


def test_a_missing_device_is_one_line_and_exit_code_3(sim_run: Any) -> None:
    run = sim_run("--stepped", "--set", "camera.driver='v4l2'", "--set", "camera.device='/dev/video99'")
    assert run.finish(30) == 3, "".join(run.lines)
    assert sum(line.startswith("davpc:") for line in run.lines) == 1


def test_results_hold_what_programs_rely_on(sim_run: Any) -> None:
    run = sim_run("--stepped", "--start", "2.2,0.0,0")
    assert run.finish() == 0
    results = json.loads((run.out / "results.json").read_text())
    assert set(results["metrics"]) == {"e_x_cm", "e_y_cm", "e_theta_deg", "e_p_px", "m_v", "m_w", "duration_s"}
    assert set(results["frames"]) == {"seen", "dropped"}
    assert set(results["image_to_can_ms"]) == {"p50", "p99"}
    assert all(isinstance(value, float) for value in results["metrics"].values())
