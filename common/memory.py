"""Locked memory: a real-time process never waits for a page (mlockall(2))."""

from __future__ import annotations

import ctypes
import os
import resource
from pathlib import Path

_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4
_CAP_IPC_LOCK = 14


def lock_memory() -> str:
    """Lock every page of this process from its first use on; returns "", or the reason if that is not permitted.

    With a finite limit nothing is locked: a later allocation could fail in the middle of a motion.
    """
    limit, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    if limit != resource.RLIM_INFINITY and not _privileged():
        return f"RLIMIT_MEMLOCK is {limit // 1024} KiB, not infinite"
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT):
        return os.strerror(ctypes.get_errno())
    return ""


def _privileged() -> bool:
    """Whether this process has CAP_IPC_LOCK, which overrides the limit."""
    lines = Path("/proc/self/status").read_text().split("\n")
    (effective,) = (int(line.split()[1], 16) for line in lines if line.startswith("CapEff:"))
    return bool(effective >> _CAP_IPC_LOCK & 1)
