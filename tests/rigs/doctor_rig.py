"""What a finding of the doctor has to hold."""

from __future__ import annotations

from station.doctor.findings import (
    Finding,
    Status,
)


def told(finding: Finding, status: Status, *words: str) -> None:
    """The finding is of this status, and its line has these words."""
    assert finding.status == status, finding
    for word in words:
        assert word in finding.line(), finding
    if status in ("warning", "failed"):
        assert finding.remedy, "a complaint names a remedy"
