"""What a process holds, from /proc, and how fast it grows."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np


class Held(NamedTuple):
    """At one moment: seconds since the begin, resident MB, open descriptors, threads."""

    t_s: float
    resident_mb: float
    descriptors: int
    threads: int


def resident_mb(pid: int | str = "self") -> float:
    """Resident memory of a process.

    Raises:
        OSError: it does not live.
    """
    pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def held(pid: int, t_s: float) -> Held:
    """What a process holds now.

    Raises:
        OSError: it does not live.
    """
    folder = Path(f"/proc/{pid}")
    return Held(t_s, resident_mb(pid), len(os.listdir(folder / "fd")), len(os.listdir(folder / "task")))


def slope_per_h(times_s: Sequence[float], values: Sequence[float]) -> float | None:
    """Growth per hour by linear regression; None for fewer than three values, or none that differ in time."""
    if len(times_s) < 3 or np.ptp(times_s) == 0.0:
        return None
    return 3600.0 * float(np.polyfit(np.asarray(times_s), np.asarray(values), 1)[0])
