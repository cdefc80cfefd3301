"""A probe that fails or hangs is a line; the report is for programs too."""

from __future__ import annotations

import threading
from collections.abc import Callable

import pytest

from common.errors import ConfigError, DeviceError
from station.doctor.findings import (
    Seen,
    as_table,
    failed,
    is_well,
    look,
    ok,
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
    assert look(raising(error), 10.0) == Seen(why=line)


def test_a_probe_that_hangs_is_left_behind() -> None:
    never = threading.Event()
    assert look(never.wait, 0.05).why == "no answer within 0 s"
    never.set()
    assert look(lambda: 3, 10.0) == Seen(3)


def test_the_report() -> None:
    findings = [ok("a", "well"), warning("b", "old", "renew"), skipped("c", "there is none")]
    assert is_well(findings)
    assert summary(findings) == "1 warning, 1 ok, 1 skipped"
    assert findings[1].line().split() == ["warning", "b", "old", "→", "renew"]
    findings.append(failed("d", "broken", "mend"))
    assert not is_well(findings)
    table = as_table(findings)
    assert table["ok"] is False
    assert table["findings"][3] == {"check": "d", "status": "failed", "seen": "broken", "remedy": "mend"}
