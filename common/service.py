"""What the system gives a process: real-time priority, locked memory, a service manager that watches it."""

from __future__ import annotations

import ctypes
import logging
import os
import resource
import socket
from pathlib import Path

from common.processes import Process

_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4
_CAP_IPC_LOCK = 14


def be_real_time(entry: Process, log: logging.Logger) -> None:
    """Set SCHED_FIFO for this thread and those that it starts, and lock the memory; warn about what is not permitted.

    Under systemd the unit already has its priority, and no right to change it.
    """
    given = os.sched_getscheduler(0) == os.SCHED_FIFO and os.sched_getparam(0).sched_priority == entry.priority
    try:
        if not given:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(entry.priority))
    except OSError as error:
        log.warning(
            "no real-time priority %d (%s): deadlines may be missed under load", entry.priority, error.strerror
        )
    refused = lock_memory() if entry.locked else ""
    if refused:
        log.warning("memory is not locked (%s): a page fault may delay the loop", refused)


def lock_memory() -> str:
    """mlockall(2): lock every page of this process from its first use on; returns "", or the reason of a refusal.

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


def notify_service_manager(state: str) -> None:
    """sd_notify(3): report a state to systemd, if it started this process."""
    address = os.environ.get("NOTIFY_SOCKET")
    if not address:
        return
    target = "\0" + address[1:] if address.startswith("@") else address
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as channel:
        channel.sendto(state.encode(), target)
