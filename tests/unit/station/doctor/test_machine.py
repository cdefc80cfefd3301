"""Findings about the computer."""

from __future__ import annotations

from pathlib import Path

import pytest

from common.processes import PROCESSES
from station.doctor import probes as doctor_probes
from station.doctor.examination import Examination
from station.doctor.findings import (
    Finding,
)
from station.doctor.machine import (
    UnitState,
    check_clock,
    check_disk,
    check_packages,
    check_python,
    check_realtime,
    check_units,
    expected_units,
    locked_versions,
)
from tests.rigs.station_rig import found

LOCK = "numpy==2.2.1 ; python_version < '3.12' \\\n    --hash=sha256:00\nnumpy==2.3.0\nPy_Yaml[x]==6.0\n"


def test_python_and_packages() -> None:
    found(check_python((3, 11, 2), "0.1.0", "/opt"), "ok", "3.11.2", "0.1.0")
    found(check_python((3, 10, 9), "0.1.0", "/opt"), "failed", "3.11 or newer")
    assert locked_versions(LOCK) == {"numpy": {"2.2.1", "2.3.0"}, "py-yaml": {"6.0"}}
    found(check_packages(LOCK, {"numpy": "2.3.0", "other": "1"}, ["numpy"]), "ok", "1 as locked")
    found(check_packages(LOCK, {"numpy": "2.4.0"}, ["numpy"]), "failed", "numpy 2.4.0 instead of 2.2.1 or 2.3.0")
    found(check_packages(LOCK, {}, ["numpy"]), "failed", "missing: numpy")
    found(check_packages(None, {"numpy": "2.3.0"}, ["numpy"]), "skipped", "no lock file")


def test_disk() -> None:
    found(check_disk("disk", "/var", 5_000_000_000, 200, 1000), "ok", "5000 MB")
    found(check_disk("disk", "/var", 900_000_000, 200, 1000), "warning", "900 MB free in /var")
    found(check_disk("disk", "/var", 100_000_000, 200, 1000), "failed", "at least 200 MB")


def test_clock() -> None:
    found(check_clock(True, 0.001, 2e9, 1e9), "ok", "synchronised")
    found(check_clock(None, 0.0, 2e9, 1e9), "ok", "cannot tell")
    found(check_clock(False, 0.0, 2e9, 1e9), "warning", "not synchronised")
    found(check_clock(True, -3600.0, 2e9, 1e9), "warning", "stepped by -3600.00 s")
    found(check_clock(True, 0.0, 1e9, 2e9), "failed", "before davpc's own files")


def test_real_time() -> None:
    wanted = {"leader": 40, "follower-arms": 40}
    found(check_realtime({"leader": 40}, wanted, False, True), "ok", "1 processes")
    found(check_realtime({"leader": None}, wanted, True, True), "failed", "leader")
    found(check_realtime({"leader": 39}, wanted, True, False), "warning", "leader", "ulimit")
    found(check_realtime({}, wanted, False, True), "ok", "units")
    found(check_realtime({}, wanted, True, False), "ok", "allowed")
    found(check_realtime({}, wanted, False, False), "warning", "not allowed")


def units(**changed: UnitState) -> dict[str, UnitState]:
    names = expected_units([entry for entry in PROCESSES if entry.robot == "leader"])
    states = {name: UnitState("loaded", "active") for name in [*names, "davpc-leader.target"]}
    states["davpc-safe.target"] = UnitState("loaded", "inactive")
    renamed = {"davpc-" + name.replace("__", ".").replace("_", "-"): state for name, state in changed.items()}
    return {**states, **renamed}


def test_units() -> None:
    safe = "davpc-safe.target"

    def check(**changed: UnitState) -> Finding:
        return check_units("leader", units(**changed), safe)

    found(check(), "ok", "2 run")
    found(check(leader__target=UnitState("loaded", "inactive")), "ok", "stopped")
    found(check(leader__service=UnitState("loaded", "active", restarts=2)), "warning", "davpc-leader.service ×2")
    found(check(leader__service=UnitState("loaded", "failed", "exit-code")), "failed", "exit-code")
    found(check(leader__service=UnitState("loaded", "inactive")), "failed", "not running: davpc-leader.service")
    found(check(leader_gateway__service=UnitState("loaded", "inactive")), "warning", "certificates")
    found(check(safe__target=UnitState("loaded", "active")), "failed", "safe stop")
    found(check(leader__target=UnitState("not-found", "inactive")), "skipped", "not installed")
    found(check_units("leader", None, safe), "skipped", "systemd does not run here")


def test_a_service_manager_that_does_not_answer_is_not_taken_for_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor_probes, "_SYSTEMD", tmp_path)
    monkeypatch.setattr(doctor_probes, "_output", lambda _: None)
    findings = {found.check: found for found in Examination(("leader",), tmp_path, tmp_path / "none.toml").findings()}
    found(findings["units leader"], "warning", "systemctl did not answer")
    monkeypatch.setattr(doctor_probes, "_SYSTEMD", tmp_path / "none")
    findings = {found.check: found for found in Examination(("leader",), tmp_path, tmp_path / "none.toml").findings()}
    found(findings["units leader"], "skipped", "systemd does not run here")
