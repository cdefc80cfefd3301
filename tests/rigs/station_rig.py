"""What tests of the station share: its command line, and what a finding of the doctor has to hold."""

from __future__ import annotations

import contextlib
import io
import subprocess
import sys
from unittest import mock

from station.cli import main
from station.doctor.findings import (
    Finding,
    Status,
)


def davpc(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the command line in a process of its own."""
    return subprocess.run(
        [sys.executable, "-m", "station.cli", *arguments], capture_output=True, text=True, timeout=60, check=False
    )


def davpc_in_process(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the same entry point in this process: a second faster, for commands that end by themselves at once."""
    stdout, stderr, code = io.StringIO(), io.StringIO(), 0
    with (
        mock.patch.object(sys, "argv", ["davpc", *arguments]),
        contextlib.redirect_stdout(stdout),
        contextlib.redirect_stderr(stderr),
    ):
        try:
            main()
        except SystemExit as end:
            code = int(end.code or 0)
    return subprocess.CompletedProcess(arguments, code, stdout.getvalue(), stderr.getvalue())


def found(finding: Finding, status: Status, *words: str) -> None:
    """The finding is of this status, and says these words."""
    assert finding.status == status, finding
    for word in words:
        assert word in finding.line(), finding
    if status in ("warning", "failed"):
        assert finding.remedy, "a complaint says what to do"
