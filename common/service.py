"""What the system gives a process: real-time priority, locked memory, a service manager that watches it."""

from __future__ import annotations

import logging
import os
import socket

from common.memory import lock_memory
from common.processes import Process


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


def notify_service_manager(state: str) -> None:
    """sd_notify(3): report a state to systemd, if it started this process."""
    address = os.environ.get("NOTIFY_SOCKET")
    if not address:
        return
    target = "\0" + address[1:] if address.startswith("@") else address
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as channel:
        channel.sendto(state.encode(), target)
