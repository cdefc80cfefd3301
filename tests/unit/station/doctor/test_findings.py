"""A probe that fails or hangs is a line; the report is for programs too."""

from __future__ import annotations

import threading
from collections.abc import Callable

import pytest

from common.errors import ConfigError, DeviceError
from station.doctor.findings import (
    ProbeResult,
    as_table,
    failed,
    is_well,
    ok,
    run_probe,
    skipped,
    summary,
    warning,
)


def raising(error: Exception) -> Callable[[], int]:
    def probe() -> int:
        raise error

    return probe


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (ConfigError("robots.toml: no"), "robots.toml: no"),
        (DeviceError("camera: no"), "camera: no"),
        (PermissionError(13, "Permission denied", "/x"), "/x: Permission denied"),
        (KeyError("surprise"), "KeyError: 'surprise'"),
        (ValueError("two\nlines"), "ValueError: two"),
    ],
)
def test_a_probe_that_fails_is_a_line(error: Exception, line: str) -> None:
    assert run_probe(raising(error), 10.0) == ProbeResult(why=line)


def test_a_probe_that_hangs_is_left_behind() -> None:
    never = threading.Event()
    assert run_probe(never.wait, 0.05).why == "no answer within 0 s"
    never.set()
    assert run_probe(lambda: 3, 10.0) == ProbeResult(3)


def test_the_report() -> None:
    findings = [ok("a", "well"), warning("b", "old", "renew"), skipped("c", "there is none")]
    assert is_well(findings)
    assert summary(findings) == "1 warning, 1 ok, 1 skipped\nnot looked at: c"
    assert findings[1].line().split() == ["warning", "b", "old", "→", "renew"]
    findings.append(failed("d", "broken", "mend"))
    assert not is_well(findings)
    table = as_table(findings)
    assert table["ok"] is False
    assert table["findings"][3] == {"check": "d", "status": "failed", "seen": "broken", "remedy": "mend"}
