"""Tools that look into a running robot, and their words when there is none."""

from __future__ import annotations

import math
import shutil
import socket
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import typer

from common.config import Config
from common.geometry import Pose2, features_at
from follower.model.taught import load
from station.calibrate.mount_file import load_views
from station.cli import app
from tests.rigs.station_rig import davpc, davpc_in_process
from tests.rigs.waiting import until

STANDS = Pose2(-2.2, 0.05, math.radians(2.0))  # Follower in {L}


@pytest.mark.alone
def test_camera_tools_on_a_running_robot(tmp_path: Path, config: Config) -> None:
    """World, camera and estimator are enough; nothing is armed, the robot stands."""
    runtime = Path(tempfile.mkdtemp(prefix="davpc-test-"))
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    settings = [f"{robot}_can.bus.port={port}" for robot in ("follower", "leader")]
    settings.append(f"world.start={[-STANDS.x_m, STANDS.y_m, math.degrees(STANDS.theta_rad)]}")
    words = [word for setting in settings for word in ("--set", setting)]
    processes = [
        subprocess.Popen([sys.executable, "-m", "station.cli", "run", name, "--runtime", str(runtime), *words])
        for name in ("world", "leader", "follower-camera", "follower-estimator")
    ]
    try:
        until(lambda: (runtime / "frames.ring").exists(), 60)
        picture = tmp_path / "now.png"
        taken = davpc("camera", "snapshot", "--runtime", str(runtime), "--out", str(picture))
        assert taken.returncode == 0, taken.stderr
        image = cv2.imread(str(picture), cv2.IMREAD_GRAYSCALE)
        assert image is not None
        assert image.shape == (1024, 1280)
        focus = davpc("camera", "focus", "--runtime", str(runtime), "--frames", "5")
        assert focus.returncode == 0, focus.stderr
        assert "4 spots" in focus.stdout
        _teach(runtime, tmp_path / "taught-1.json", config)
        _view(runtime, tmp_path / "views.json", config)
    finally:
        for process in processes:
            process.terminate()
        for process in processes:
            process.wait(timeout=30)
        shutil.rmtree(runtime)


def _teach(runtime: Path, path: Path, config: Config) -> None:
    done = davpc("teach", "1", "--frames", "30", "--runtime", str(runtime), "--out", str(path))
    assert done.returncode == 0, done.stderr
    taught = load(path, config.camera)
    truth = STANDS.inverse()
    assert (taught.trolley, taught.frames) == (1, 30)
    assert taught.pose.as_array() == pytest.approx(truth.as_array(), abs=0.02)
    assert taught.features == pytest.approx(features_at(config.leds.points, truth, config.camera.mount), abs=1e-3)
    assert taught.offset_px > 5.0, "it stands before the goal, and that is reported"


def _view(runtime: Path, path: Path, config: Config) -> None:
    truth = STANDS.inverse()
    measured = f"{truth.x_m},{truth.y_m},{math.degrees(truth.theta_rad)}"
    for count in (1, 2):
        done = davpc("calibrate", "view", measured, "--frames", "30", "--runtime", str(runtime), "--out", str(path))
        assert done.returncode == 0, done.stderr
        assert f"{count} views" in done.stdout
    for view in load_views(path, len(config.leds.points)):
        assert view.relative.as_array() == pytest.approx(truth.as_array())
        expected = features_at(config.leds.points, truth, config.camera.mount)
        assert view.features == pytest.approx(expected, abs=1e-3)


def test_without_a_robot_they_say_so() -> None:
    for arguments, code, said in (
        (("camera", "snapshot"), 2, "needs a running simulation"),
        (("teach", "1"), 3, "no robot runs here"),
        (("calibrate", "camera", "absent-folder"), 2, "no such folder"),
        (("calibrate", "mount", "absent.json"), 2, "absent.json"),
        (("calibrate", "view", "2,0,0"), 3, "no robot runs here"),
        (("calibrate", "camera"), 2, "a folder of images, or --live"),
        (("calibrate", "camera", "here", "--board", "1x1"), 2, "--board 1x1"),
        (("calibrate", "check", "absent.toml"), 2, "absent.toml"),
        (("camera", "snapshot", "--out", "picture.foo"), 2, "picture.foo"),
        (("run", "follower-nose"), 2, "no process 'follower-nose'"),
        (("run", "leader", "--runtime", "/nowhere"), 2, "/nowhere"),
        (("experiment", "table1", "--methods", "magic"), 2, "no method 'magic'"),
        (("dock", "status", "--runtime", "/nowhere"), 1, "no robot runs here"),
        (("dock", "start", "--trolley", "2", "--runtime", "/nowhere"), 1, "no robot runs here"),
        (("led", "set", "much", "--runtime", "/nowhere"), 1, "write amperes"),
        (("lock", "open", "--yes", "--runtime", "/nowhere"), 1, "no robot runs here"),
    ):
        ended = davpc_in_process(*arguments)
        assert ended.returncode == code, ended
        assert said in ended.stderr
        assert "Traceback" not in ended.stderr


def test_a_board_in_view_is_calibrated_from_a_folder(tmp_path: Path) -> None:
    blank = np.zeros((100, 120), np.uint8)
    cv2.imwrite(str(tmp_path / "blank.png"), blank)
    ended = davpc("calibrate", "camera", str(tmp_path))
    assert ended.returncode == 2
    assert "no whole board, left out" in ended.stdout
    assert "0 images with the whole board" in ended.stderr


def test_help_shows_every_command_with_an_example() -> None:
    cli: Any = typer.main.get_command(app)
    text = " ".join(davpc("--help").stdout.replace("│", "").split())
    missing = [name for name in cli.commands if f"davpc {name}`" not in text and f"davpc {name} " not in text]
    assert not missing
