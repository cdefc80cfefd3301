"""The units against the process table, systemd's own verifier and its measure of exposure."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from common.processes import PROCESSES, Process
from station.cli import app
from tests.deploy.units import ROOT, SYSTEMD, VARIANTS, merged, read, unit_of, words

SAFE = "davpc-safe.target"
COMPOSE = ROOT / "docker/compose.yaml"
ROBOTS = ("follower", "leader")
SERVICES = sorted(path.name for path in SYSTEMD.glob("davpc-*.service"))
EXPOSURE = {"davpc-follower-camera.service": 2.0, "davpc-follower-can-bridge.service": 2.0}
EXPOSURE_OTHERS = 1.5

needs_systemd = pytest.mark.skipif(
    shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed (package systemd)"
)


@pytest.fixture(params=["plain", *VARIANTS])
def unit_path(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """The units as installed, alone or with a variant's drop-ins; their command is one that exists here."""
    folder = tmp_path / "system"
    shutil.copytree(SYSTEMD, folder, symlinks=True)
    if request.param != "plain":
        shutil.copytree(VARIANTS[request.param], folder, dirs_exist_ok=True)
    for path in folder.glob("*.service"):
        path.write_text(path.read_text().replace("/opt/davpc/current/bin/davpc", sys.executable))
    return folder


RECORDER_UNIT = "davpc-follower-recorder.service"


def analyze(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["systemd-analyze", "--no-pager", *arguments],
        cwd=folder,
        env={"SYSTEMD_UNIT_PATH": f"{folder}:/usr/lib/systemd/system:/lib/systemd/system", "PATH": "/usr/bin:/bin"},
        capture_output=True,
        text=True,
        check=False,
    )


def test_every_process_has_a_unit_and_every_unit_a_process() -> None:
    assert sorted(unit_of(entry.name) for entry in PROCESSES) == SERVICES


@pytest.mark.parametrize("entry", PROCESSES, ids=lambda entry: entry.name)
def test_a_unit_runs_its_process_with_the_priority_of_the_table(entry: Process) -> None:
    settings = merged(unit_of(entry.name))
    (command,) = settings["Service.ExecStart"]
    assert command == f"/opt/davpc/current/bin/davpc run {entry.name}"
    assert settings["Service.CPUSchedulingPolicy"] == ["fifo"]
    assert settings["Service.CPUSchedulingPriority"] == [str(entry.priority)]


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_robots_target_pulls_in_exactly_its_processes_and_takes_them_down(robot: str) -> None:
    target = f"davpc-{robot}.target"
    units = {unit_of(entry.name) for entry in PROCESSES if entry.robot == robot}
    assert words(read(SYSTEMD / target), "Unit.Wants") == units
    assert all(merged(unit)["Unit.PartOf"] == [target] for unit in units)
    assert target in words(read(SYSTEMD / SAFE), "Unit.Conflicts")


def test_the_simulated_backend_comes_with_the_follower_in_its_variant_only() -> None:
    assert read(VARIANTS["simulated"] / "davpc-follower.target.d/60-simulated.conf")["Unit.Wants"] == [
        "davpc-world.service"
    ]
    assert merged("davpc-world.service")["Unit.PartOf"] == ["davpc-follower.target"]


@pytest.mark.parametrize("unit", SERVICES)
def test_a_process_that_fails_for_good_leads_to_the_safe_target_unless_robots_dock_without_it(unit: str) -> None:
    settings = merged(unit)
    assert settings["Service.Type"] == ["notify"]
    assert settings["Service.WatchdogSec"] == ["2"]
    assert settings["Service.WatchdogSignal"] == ["SIGKILL"]
    assert settings["Service.MemoryMax"] != []
    assert settings["Service.Restart"] == ["always"]
    if unit.endswith("-gateway.service"):
        assert settings["Unit.OnFailure"] == []
        assert settings["Unit.StartLimitIntervalSec"][-1] == "0"
    elif unit == RECORDER_UNIT:
        assert settings["Unit.OnFailure"] == [], "a docking needs no record"
    else:
        assert words(settings, "Unit.OnFailure") == {SAFE, "davpc_safe@%N.service"}
        assert settings["Unit.StartLimitIntervalSec"] == ["60"]
        assert settings["Unit.StartLimitBurst"] == ["5"]


@pytest.mark.parametrize("unit", SERVICES)
def test_only_those_who_need_it_have_a_device_or_a_network(unit: str) -> None:
    settings = merged(unit)
    network = {"davpc-follower-can-bridge.service", "davpc-leader.service", "davpc-world.service"}
    network |= {unit for unit in SERVICES if unit.endswith("-gateway.service")}
    assert settings["Service.PrivateNetwork"][-1] == ("no" if unit in network else "yes")
    assert (settings["Service.PrivateDevices"][-1] == "no") == (unit == "davpc-follower-camera.service")
    assert ("Service.LoadCredential" in settings) == unit.endswith("-gateway.service")


def test_the_real_buses_are_waited_for_and_speak_no_internet_protocol() -> None:
    for unit in ("davpc-follower-can-bridge.service", "davpc-leader.service"):
        settings = merged(unit)
        assert "AF_CAN" in words(settings, "Service.RestrictAddressFamilies")
        assert "AF_INET" not in words(settings, "Service.RestrictAddressFamilies")
        waits = read(VARIANTS["hardware"] / f"{unit}.d/60-can0.conf")
        assert waits["Unit.Requires"] == waits["Unit.After"] == ["sys-subsystem-net-devices-can0.device"]


def test_the_command_line_lists_the_same_processes(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        app(["processes"])
    listed = [line.split()[0] for line in capsys.readouterr().out.splitlines()]
    assert sorted(map(unit_of, listed)) == SERVICES


def test_the_compose_file_has_a_service_of_the_same_name_for_each_process() -> None:
    services = re.findall(r"^  ([a-z-]+):\n(?:    .*\n)*?    command: \[run, ([a-z-]+)\]$", COMPOSE.read_text(), re.M)
    assert all(service == process for service, process in services)
    assert sorted(unit_of(process) for _, process in services) == SERVICES


@needs_systemd
def test_systemd_finds_no_fault(unit_path: Path) -> None:
    names = [path.name for path in unit_path.glob("*.*") if path.is_file()]
    found = analyze(unit_path, "verify", "--recursive-errors=no", *(f"./{name}" for name in names))
    assert found.stdout + found.stderr == ""
    assert found.returncode == 0


@needs_systemd
def test_systemd_finds_a_fault_that_is_there(tmp_path: Path) -> None:
    """Positive control: the verifier reads the drop-ins of the prefix."""
    folder = tmp_path / "system"
    shutil.copytree(SYSTEMD, folder, symlinks=True)
    common = folder / "davpc-.service.d/10-process.conf"
    common.write_text(common.read_text().replace("KillMode=mixed", "KillMode=mixd"))
    found = analyze(folder, "verify", "--recursive-errors=no", "./davpc-leader.service")
    assert "mixd" in found.stderr


@needs_systemd
@pytest.mark.parametrize("unit", [*SERVICES, "davpc_safe@.service"])
def test_exposure(unit_path: Path, unit: str) -> None:
    limit = EXPOSURE.get(unit, EXPOSURE_OTHERS)
    found = analyze(unit_path, "security", "--offline=true", f"--threshold={round(limit * 10)}", f"./{unit}")
    assert found.returncode == 0, found.stdout[-400:] + found.stderr
