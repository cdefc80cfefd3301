"""Locked memory, in processes of their own: where it is allowed, and where it is not."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from common.service import _privileged

_SHOW = """
import os, resource
from pathlib import Path
from common.service import lock_memory
{before}
reason = lock_memory()
locked = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmLck"))
print(reason or int(locked.split()[1]))
"""


def outcome(before: str) -> str:
    shown = subprocess.run([sys.executable, "-c", _SHOW.format(before=before)], capture_output=True, text=True)
    assert shown.returncode == 0, shown.stderr
    return shown.stdout.strip()


def test_without_permission_nothing_is_locked_and_the_limit_is_named() -> None:
    limit = "resource.setrlimit(resource.RLIMIT_MEMLOCK, (65536, 65536))"
    drop = "os.setuid(65534)" if os.geteuid() == 0 else ""
    assert outcome(f"{limit}\n{drop}") == "RLIMIT_MEMLOCK is 64 KiB, not infinite"


@pytest.mark.skipif(not _privileged(), reason="needs CAP_IPC_LOCK")
def test_with_permission_pages_are_locked() -> None:
    assert int(outcome("")) > 1000
