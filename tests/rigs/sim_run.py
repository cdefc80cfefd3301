"""Whole runs of ``davpc sim``: helpers that start, find and overhear its processes."""

from __future__ import annotations

import functools
import json
import struct
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import can
import pytest

from tests.rigs import host
from tests.rigs.waiting import until


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

    def finish(self, seconds: float = 200.0) -> int:
        """Wait for the end; the exit code."""
        code = self.process.wait(timeout=seconds)
        self._reader.join()
        return code

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


_ALL_TRIES_S = 900


def judged_on_a_calm_host(*, stepped: str) -> Callable[[Any], Any]:
    """Let a test with real-time processes be repeated with fresh ones where the host itself was in their way.

    Args:
        stepped: the test that asserts the same of the same nodes in stepped time, by its node id.
    """

    def judged(test: Any) -> Any:
        @functools.wraps(test)
        def wrapper(*args: Any, **kwargs: Any) -> None:
            def attempt() -> None:
                try:
                    test(*args, **kwargs)
                finally:  # or a repeat would share the cores with it
                    if "sim_run" in kwargs:
                        kwargs["sim_run"].stop()

            host.judged_on_a_calm_host(attempt)

        return pytest.mark.stepped_twin(stepped)(pytest.mark.timeout(_ALL_TRIES_S)(wrapper))

    return judged


class SimRuns:
    """Starts runs, each in a folder of its own, and ends them."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._runs: list[SimRun] = []

    def __call__(self, *arguments: str) -> SimRun:
        self._runs.append(SimRun(self._folder / f"run{len(self._runs)}", *arguments))
        return self._runs[-1]

    def stop(self) -> None:
        """End those that still run."""
        for run in self._runs:
            if run.process.poll() is None:
                run.process.terminate()
            run.finish(30)


def is_docked(results: dict[str, Any]) -> bool:
    metrics = results["metrics"]
    return bool(
        results["connected"]
        and results["cause"] == "docked"
        and metrics["e_y_cm"] <= 2.0
        and metrics["e_theta_deg"] <= 1.0
        and metrics["duration_s"] <= 60.0
    )
