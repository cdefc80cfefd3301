"""Whole runs of ``davpc sim``: helpers that find, kill and overhear its processes."""

from __future__ import annotations

import functools
import json
import os
import signal
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import can
import pytest

from tests.host import HostWatch, cannot_judge


class SimRun:
    """One ``davpc sim`` in its own process."""

    def __init__(self, out: Path, *arguments: str) -> None:
        self.out = out
        self.process = subprocess.Popen(
            [sys.executable, "-m", "station.cli", "sim", "--headless", "--out", str(out), *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self.lines: list[str] = []
        self.host = HostWatch()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        with self.process.stdout as stdout:
            self.lines.extend(iter(stdout.readline, ""))

    def wait_for(self, text: str, seconds: float = 90.0) -> None:
        """Until a line of its output holds ``text``."""
        until(lambda: any(text in line for line in self.lines) or self.process.poll() is not None, seconds)
        assert any(text in line for line in self.lines), "".join(self.lines)

    def children(self) -> dict[str, int]:
        """Process ids of the runtime's processes by name."""
        found = {}
        for stat in Path("/proc").glob("[0-9]*/stat"):
            try:
                parent = int(stat.read_text().rsplit(")", 1)[1].split()[1])
                words = (stat.parent / "cmdline").read_text().split("\0")
            except (OSError, ValueError):
                continue
            if parent == self.process.pid and "run" in words:
                found[words[words.index("run") + 1]] = int(stat.parent.name)
        return found

    def option(self, key: str) -> str:
        """Value of an override that the launcher gave its processes."""
        words = Path(f"/proc/{next(iter(self.children().values()))}/cmdline").read_text().split("\0")
        return next(word.partition("=")[2] for word in words if word.startswith(key + "="))

    def runtime(self) -> Path:
        """The private directory of this run."""
        words = Path(f"/proc/{next(iter(self.children().values()))}/cmdline").read_text().split("\0")
        return Path(words[words.index("--runtime") + 1])

    def finish(self, seconds: float = 150.0) -> int:
        """Wait for the end; the exit code."""
        code = self.process.wait(timeout=seconds)
        self._reader.join()
        self.host.close()
        return code

    def stalled(self) -> bool:
        """Whether the machine stood still meanwhile: its canaries or its processes noticed."""
        if self.host.stood_still():
            return True
        logs = "".join(path.read_text(errors="replace") for path in (self.out / "logs").glob("*.log"))
        return any(word in logs for word in _STALL_WORDS)

    def results(self) -> dict[str, Any]:
        """What it wrote."""
        content: dict[str, Any] = json.loads((self.out / "results.json").read_text())
        return content


class CanTap:
    """Overhears the Follower's bus; stamps are those of the simulated bus, CLOCK_MONOTONIC."""

    def __init__(self, run: SimRun, wheels: tuple[int, int]) -> None:
        port = int(run.option("follower_can.bus.port"))
        self._bus = can.Bus(interface="socketcand", host="127.0.0.1", port=port, channel="follower")
        self._wheels = wheels
        self.targets: list[tuple[float, int, int]] = []
        self.emergencies: list[tuple[float, int, int]] = []
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def _listen(self) -> None:
        while not self._stop.is_set():
            try:
                message = self._bus.recv(0.2)
            except (OSError, can.CanError):
                return
            if message is None:
                continue
            node = message.arbitration_id & 0x7F
            if message.arbitration_id & 0x780 == 0x200 and node in self._wheels:
                _, target = struct.unpack("<Hi", message.data)
                self.targets.append((message.timestamp, node, target))
            elif message.arbitration_id & 0x780 == 0x80 and node in self._wheels:
                self.emergencies.append((message.timestamp, node, struct.unpack_from("<H", message.data)[0]))

    def close(self) -> None:
        """Stop listening."""
        self._stop.set()
        self._thread.join()
        self._bus.shutdown()


# what bridge and world log when the host stood still for so long that the robot had to stop
_STALL_WORDS = ("stood still",)
_TRIES = 5
_ALL_TRIES_S = 1200
_CALM_S, _STALL_S, _PATIENCE_S = 3.0, 0.05, 60.0


def repeated_after_host_stall(test: Any) -> Any:
    """Run the test again, with fresh processes, if it failed in a run in which the machine itself stood still.

    A stall stops the robot, rightly: it says nothing about what the test asserts. A failure without one stands. Where
    canaries saw the host stand still in every try, the test is skipped and says so.
    """

    @functools.wraps(test)
    def wrapper(*args: Any, **kwargs: Any) -> None:
        for attempt in range(1, _TRIES + 1):
            before = len(kwargs["sim_run"].runs)
            try:
                test(*args, **kwargs)
            except (AssertionError, pytest.fail.Exception):
                mine = kwargs["sim_run"].runs[before:]
                if not any(run.stalled() for run in mine):
                    raise
                if attempt == _TRIES:
                    cannot_judge([run.host for run in kwargs["sim_run"].runs])
                    raise
                _until_the_machine_is_calm()
            else:
                return

    return pytest.mark.timeout(_ALL_TRIES_S)(wrapper)


def _until_the_machine_is_calm() -> None:
    """Wait until nothing has stood still for a while: stalls of the host come in bursts."""
    begin = before = calm_since = time.monotonic()
    while before - calm_since < _CALM_S and before - begin < _PATIENCE_S:
        time.sleep(0.005)
        now = time.monotonic()
        if now - before > _STALL_S:
            calm_since = now
        before = now


def until(condition: Any, seconds: float) -> None:
    """Wait for a condition, or fail."""
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            pytest.fail("waited in vain")
        time.sleep(0.01)


@pytest.fixture
def sim_run(tmp_path: Path) -> Iterator[Any]:
    """Starts runs and leaves none behind."""
    runs: list[SimRun] = []

    def start(*arguments: str) -> SimRun:
        runs.append(SimRun(tmp_path / f"run{len(runs)}", *arguments))
        return runs[-1]

    start.runs = runs  # type: ignore[attr-defined]

    yield start
    for run in runs:
        if run.process.poll() is None:
            os.kill(run.process.pid, signal.SIGTERM)
        run.finish(30)
