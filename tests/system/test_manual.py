"""``davpc jog``, ``grip`` and ``lift`` on real processes: world, bridge, arms and supervisor."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from common.config import default_config_path
from common.processes import PROCESSES
from station.simulate import children
from tests.rigs.waiting import until

pytestmark = pytest.mark.alone
NEEDED = ("world", "follower-can-bridge", "follower-arms", "follower-supervisor")
JOG = ("jog", "--speed", "0.05")


@pytest.fixture
def robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A robot without eyes; its runtime directory."""
    some = tuple(entry for entry in PROCESSES if entry.name in NEEDED)
    monkeypatch.setattr(children, "ONE_MACHINE", some)
    started: children.Children = {}
    with children.runtime_directory() as runtime, children.listening_socket() as server:
        overrides = children.with_server([], server)
        try:
            children.start_children(started, default_config_path(), overrides, runtime, tmp_path, server.fileno())
            until(lambda: all((tmp_path / f"{name}.log").read_text().count(" ready") for name in NEEDED), 30)
            yield runtime
        finally:
            children.stop_children(started)


def davpc(runtime: Path, *arguments: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "station.cli", *arguments, "--runtime", str(runtime)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def said(process: subprocess.Popen[str]) -> str:
    return process.communicate(timeout=30)[0]


def log_of(tmp_path: Path) -> str:
    return (tmp_path / "follower-supervisor.log").read_text()


def test_by_hand(robot: Path, tmp_path: Path) -> None:
    timed = davpc(robot, *JOG, "--seconds", "1")
    assert "done" in said(timed)
    assert timed.returncode == 0

    jogging = davpc(robot, *JOG)
    until(lambda: (tmp_path / "follower-can-bridge.log").read_text().count(" armed ") >= 2, 20)
    second = davpc(robot, "lift", "100")
    assert "a process operator already runs here" in said(second)
    assert second.returncode == 2
    os.kill(jogging.pid, signal.SIGKILL)
    said(jogging)
    until(lambda: "manual: " in log_of(tmp_path), 5)

    lifted = davpc(robot, "lift", "150")
    assert re.search(r"^lift at (149\.[5-9]|150\.[0-5]) mm$", said(lifted), re.MULTILINE)
    assert lifted.returncode == 0
    opened = davpc(robot, "grip", "open")
    assert "grippers open" in said(opened)
    assert opened.returncode == 0


def test_no_robot_is_one_line(tmp_path: Path) -> None:
    alone = davpc(tmp_path, *JOG)
    assert said(alone) == f"davpc: {tmp_path}: no robot runs here\n"
    assert alone.returncode == 3
