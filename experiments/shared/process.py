"""Processes as on the robot, started and watched by an experiment."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from common.errors import DeviceError

_PR_SET_PDEATHSIG = 1
_LOOK_S = 0.01
Child = subprocess.Popen[bytes]


@dataclass(frozen=True)
class Starter:
    """What every process of one bench is started with; ``keep_open`` are file descriptors that it inherits."""

    config_path: Path
    overrides: Sequence[str]
    runtime: Path
    logs: Path
    keep_open: tuple[int, ...] = ()

    def start(self, name: str) -> Child:
        """Start one process as on the robot; it appends to ``<name>.log`` and dies with this one."""
        command = [sys.executable, "-m", "station.cli", "run", name, "--runtime", str(self.runtime)]
        command += ["--config", str(self.config_path.resolve())]
        for override in self.overrides:
            command += ["--set", override]
        with (self.logs / f"{name}.log").open("ab") as log:
            return subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                pass_fds=self.keep_open,
                env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
                preexec_fn=_die_with_parent,
            )


def wait_for(
    condition: Callable[[], bool], timeout_s: float, what: str, children: Mapping[str, Child], logs: Path
) -> None:
    """Wait until a condition holds.

    Args:
        condition: polled every 10 ms.
        timeout_s: longest wait.
        what: the state to report if it does not hold in time.
        children: processes that must stay alive, by name.
        logs: folder named in errors.

    Raises:
        DeviceError: a child died by itself, or the condition does not hold in time.
    """
    deadline = time.monotonic() + timeout_s
    while not condition():
        dead = [name for name, child in children.items() if child.poll() is not None]
        if dead:
            raise DeviceError(f"{dead[0]} died by itself: see its log in {logs}")
        if time.monotonic() > deadline:
            raise DeviceError(f"{what} after {timeout_s:.0f} s: see the logs in {logs}")
        time.sleep(_LOOK_S)


def _die_with_parent() -> None:
    """In the child: ordinary scheduling, which it raises itself as on the robot, and no life without its parent."""
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
