"""Memory that stays: no page of a real-time process is ever waited for (mlockall(2))."""

from __future__ import annotations

import ctypes
import os
import resource
from pathlib import Path

_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4
_CAP_IPC_LOCK = 14


def lock_memory() -> str:
    """Keep every page of this process in memory from its first use on; the reason if that is not allowed, else "".

    A finite limit would let a later allocation fail in the middle of a motion: then nothing is locked.
    """
    limit, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    if limit != resource.RLIM_INFINITY and not _privileged():
        return f"RLIMIT_MEMLOCK is {limit // 1024} KiB, not infinite"
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT):
        return os.strerror(ctypes.get_errno())
    return ""


def _privileged() -> bool:
    """Whether this process has CAP_IPC_LOCK, which no limit binds."""
    lines = Path("/proc/self/status").read_text().splitlines()
    (effective,) = (int(line.split()[1], 16) for line in lines if line.startswith("CapEff:"))
    return bool(effective >> _CAP_IPC_LOCK & 1)
