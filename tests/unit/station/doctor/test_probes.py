"""What the doctor reads of the machine."""

from __future__ import annotations

from pathlib import Path

from station.doctor.machine import (
    UnitState,
)
from station.doctor.probes import parse_units, process_of


def test_systemctl_is_understood() -> None:
    printed = "Id=a.service\nLoadState=loaded\nActiveState=active\nResult=success\nNRestarts=3\n\nId=b.target\n"
    printed += "LoadState=not-found\nActiveState=inactive\nNRestarts=\n"
    assert parse_units(printed) == {
        "a.service": UnitState("loaded", "active", "success", 3),
        "b.target": UnitState("not-found", "inactive", "", 0),
    }


def test_command_lines_are_understood() -> None:
    runtime = Path("/run/davpc")
    assert process_of(["python", "davpc", "run", "leader", ""], runtime) == "leader"
    assert process_of(["davpc", "run", "leader", "--runtime", "/elsewhere"], runtime) == ""
    assert process_of(["davpc", "run", "leader", "--runtime", "/elsewhere"], Path("/elsewhere")) == "leader"
    assert process_of(["npm", "run", "test", ""], runtime) == ""
    assert process_of(["run"], runtime) == ""
