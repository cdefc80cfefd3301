"""Both robots dock a trolley: all processes over Zenoh and CAN."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import Any

import pytest

from common.config import Config
from common.processes import ONE_MACHINE
from station.simulate.children import runtime_directory
from tests.rigs.sim_run import CanTap, is_docked, judged_on_a_calm_host
from tests.rigs.station_rig import davpc_in_process
from tests.rigs.waiting import until

FOLLOWER = [process.name for process in ONE_MACHINE if process.robot == "follower"]
START = ("--start", "3,0.15,3")


def nothing_is_left(runtime: Path, children: dict[str, int]) -> bool:
    return not runtime.exists() and not any(Path(f"/proc/{pid}").exists() for pid in children.values())


@pytest.mark.alone
@judged_on_a_calm_host(stepped="tests/stepped/test_sim.py::test_stepped_dockings_are_bit_identical")
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
        # no process is left to send a frame: the drives' own watchdogs stop the wheels and say so
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
    # its directory stays until the next run finds that no process owns it
    with runtime_directory():
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
        (("--start", "1.2,0,0"), "inside the Leader"),
        (("--out", "/proc/nope"), "--out /proc/nope"),
        (("--attach", "/proc/nope"), "--attach /proc/nope: no robot runs here"),
        (("--set", "supervisor.approach_speed_m_s=5.0"), "supervisor.approach_speed_m_s"),
        (("--set", "camera.rate_hz=20.0"), "three frame periods"),
    ],
)
def test_a_users_mistake_is_one_line_and_exit_code_2(tmp_path: Path, arguments: tuple[str, ...], said: str) -> None:
    ended = davpc_in_process("sim", "--headless", "--out", str(tmp_path), *arguments)
    assert ended.returncode == 2
    (complaint,) = [line for line in ended.stderr.splitlines() if line.startswith("davpc:")]
    assert said in complaint
    assert "Traceback" not in ended.stderr
