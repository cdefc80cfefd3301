"""``davpc doctor`` beside running robots, on a stopped one, and with a configuration that cannot be read."""

from __future__ import annotations

import json
import shutil
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.rigs.waiting import until

# the world is the first: the others need its buses
RUNNING = ("world", "follower-can-bridge", "leader", "follower-camera", "follower-estimator")


def doctor(*arguments: str) -> tuple[int, dict[str, dict[str, Any]]]:
    """Exit code and findings by check."""
    command = [sys.executable, "-m", "station.cli", "doctor", "--json", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=200, check=False)
    assert "Traceback" not in done.stderr, done.stderr
    table = json.loads(done.stdout)
    assert table["ok"] == (done.returncode == 0)
    return done.returncode, {finding["check"]: finding for finding in table["findings"]}


@pytest.fixture
def standing() -> Iterator[tuple[Path, list[str]]]:
    """Robots that stand, some of their processes not running: runtime directory, and the options that name them."""
    runtime = Path(tempfile.mkdtemp(prefix="davpc-test-"))
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    words = [word for robot in ("follower", "leader") for word in ("--set", f"{robot}_can.bus.port={port}")]
    words += ["--runtime", str(runtime)]
    logs = {name: (runtime / f"{name}.log").open("w") for name in RUNNING}
    processes: list[subprocess.Popen[bytes]] = []
    try:
        for name, log in logs.items():
            command = [sys.executable, "-m", "station.cli", "run", name, *words]
            processes.append(subprocess.Popen(command, stdout=log, stderr=log))
            until(lambda: _listens(port), 60)
        wanted = [runtime / "frames.ring", *(runtime / f"{name}.sock" for name in logs)]
        until(lambda: all(path.exists() for path in wanted), 90)
        yield runtime, words
    finally:
        for process in processes:
            process.terminate()
        for process in processes:
            process.wait(timeout=30)
        for log in logs.values():
            log.close()
        shutil.rmtree(runtime)


def _listens(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


@pytest.mark.alone
def test_beside_running_robots(standing: tuple[Path, list[str]]) -> None:
    runtime, words = standing
    seen: dict[str, dict[str, Any]] = {}

    def all_is_received() -> bool:
        seen.update(doctor(*words)[1])
        return all(seen[check]["status"] == "ok" for check in ("LEDs seen", "Leader"))

    until(all_is_received, 90)
    assert seen["processes"]["status"] == "failed"
    assert seen["processes"]["seen"] == "not running: follower-controller, follower-arms, follower-supervisor"
    assert seen["camera rate"]["status"] != "skipped"
    assert "sim" in seen["camera rate"]["seen"]
    assert "4 of 4" in seen["LEDs seen"]["seen"]
    assert "stop inputs clear" in seen["drives"]["seen"]
    assert "26.0 V" in seen["battery"]["seen"]
    assert "lock open" in seen["Leader"]["seen"]
    for robot, master in (("follower", "follower-can-bridge"), ("leader", "leader")):
        assert seen[f"watchdogs {robot}"]["status"] == "skipped", "whose bus is in use is left alone"
        assert master in seen[f"watchdogs {robot}"]["seen"]
    assert not list(runtime.glob("doctor-*")), "it leaves nothing behind"


def test_where_nothing_runs(tmp_path: Path) -> None:
    code, seen = doctor("--runtime", str(tmp_path))
    assert code == 0, [finding for finding in seen.values() if finding["status"] == "failed"]
    for check in ("processes", "camera rate", "drives", "CAN nodes follower", "link leader"):
        assert seen[check]["status"] == "skipped"
        assert seen[check]["seen"].startswith("because ")
    assert seen["packages"]["status"] == "ok"


def test_a_configuration_that_cannot_be_read_is_a_finding(tmp_path: Path) -> None:
    (tmp_path / "robots.toml").write_text("[camera\n")
    code, seen = doctor("--config", str(tmp_path / "robots.toml"))
    assert code == 1
    assert seen["configuration"]["status"] == "failed"
    assert "robots.toml: not valid TOML" in seen["configuration"]["seen"]
    assert "disk" in seen, "the rest is looked at all the same"


def test_devices_that_are_missing_are_findings(tmp_path: Path) -> None:
    code, seen = doctor(
        *("--runtime", str(tmp_path), "--robot", "follower"),
        *("--set", "camera.driver='v4l2'", "--set", "camera.device='/dev/video-none'"),
        *("--set", "follower_can.bus={interface='socketcan', channel='can-none'}"),
    )
    assert code == 1
    assert seen["camera rate"]["status"] == "failed"
    assert "/dev/video-none" in seen["camera rate"]["seen"]
    assert seen["calibration"]["status"] == "failed"
    assert "can-none" in seen["CAN follower"]["seen"]
    assert seen["CAN nodes follower"]["status"] == "failed"
    assert not any("leader" in check for check in seen)


def test_a_device_that_hangs_does_not_keep_it(tmp_path: Path) -> None:
    """A driver call that never comes back, and holds a thread that cannot be ended."""
    script = """
import sys, threading
from station.doctor import probes as doctor_probes
from station.doctor import examination as doctor_visit
from station import cli
doctor_visit._PROBE_S = 0.5
doctor_probes.can_link = lambda channel: threading.Event().wait()
cli.main()
"""
    options = ["--json", "--no-devices", "--robot", "leader", "--runtime", str(tmp_path)]
    options += ["--set", "leader_can.bus={interface='socketcan', channel='can0'}"]
    done = subprocess.run(
        [sys.executable, "-c", script, "doctor", *options], capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 1, done.stderr
    findings = {finding["check"]: finding for finding in json.loads(done.stdout)["findings"]}
    assert "no answer within" in findings["CAN leader"]["seen"]
    assert findings["CAN nodes leader"]["seen"] == "because --no-devices"
    assert "clock" in findings, "what comes after it is looked at all the same"
