"""Runs for tests of executors: functions of a module, as workers need them."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np


class Slow(NamedTuple):
    """A run that takes some time, and leaves a file per beginning."""

    seed: int
    seconds: float
    begun: str


def noise(seed: int) -> list[float]:
    """Linear algebra on random numbers: equal only where nothing at all differs."""
    draws = np.random.default_rng(seed)
    matrix = draws.normal(size=(60, 60))
    return [float(value) for value in np.linalg.solve(matrix @ matrix.T + np.eye(60), matrix[0])]


def slow_noise(run: Slow) -> list[float]:
    """The same after a while."""
    (Path(run.begun) / f"{run.seed}-{os.getpid()}").touch()
    time.sleep(run.seconds)
    return noise(run.seed)


def lost_once(marker: str) -> str:
    """Kills its own process the first time."""
    if not Path(marker).exists():
        Path(marker).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return "done"


def lost(_: int) -> None:
    """Kills its own process every time."""
    os.kill(os.getpid(), signal.SIGKILL)


def fails(value: int) -> int:
    """An error of the run itself, and words on stdout."""
    print("solving", value)  # noqa: T201 - what a solver may do
    return 1 // value
