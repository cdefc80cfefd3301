"""The installer on a machine without a network: one machine's life, from a fresh disk to the removal.

The tests follow one another; each begins with a healthy robot and leaves one behind.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from common.config import load_config
from common.processes import PROCESSES
from tests.deploy.docking import TARGET, dock
from tests.deploy.machines import PATIENCE_S, Machine, until
from tests.deploy.probe import Probe
from tests.deploy.units import SYSTEMD, unit_of
from tests.deploy.workshop import HANGS_S, INSTALL_S, Installed, Workshop, install

pytestmark = [pytest.mark.alone, pytest.mark.timeout(HANGS_S)]

NEEDS_KEYS = ("follower-gateway",)  # and is not started without
_PLACES = ("/opt/davpc", "/etc/davpc", "/etc/systemd/system", "/usr/local/lib", "/usr/local/bin", "/var/lib/davpc")
_MINE = "# measured on our robots\n"


@pytest.fixture(scope="module")
def machine(workshop: Workshop, installed: Installed) -> Iterator[Machine]:
    """A machine on which davpc is installed, and nothing of it runs."""
    workshop.tree("v2", lambda tree: edit(tree / "pyproject.toml", 'version = "', 'version = "9.'))
    workshop.tree("broken", break_camera)
    made = workshop.machine("robot", [installed.disk], workshop.network("robot", 1).spaces[0])
    made.boot()
    yield made
    made.cut_power()


def edit(file: Path, old: str, new: str) -> None:
    """Replace a text that must be there."""
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))


def break_camera(tree: Path) -> None:
    """A release whose camera process ends when it is started."""
    edit(tree / "pyproject.toml", 'version = "', 'version = "10.')
    edit(tree / "follower/camera/node.py", "def make(", 'raise RuntimeError("broken on purpose")\n\n\ndef make(')


def snapshot(machine: Machine) -> set[str]:
    """Every file of davpc, with its time of change."""
    return set(machine.must("find", *_PLACES, "-not", "-name", "*.pyc", "-printf", r"%p %y %s %T@ %l\n").splitlines())


def release(machine: Machine, which: str = "current") -> str:
    """Name of the release in use, or of the one before."""
    return machine.must("readlink", f"/opt/davpc/{which}").strip().removeprefix("releases/")


def assert_healthy(machine: Machine) -> None:
    """Every process of the Follower runs, from the release in use, and the robot is disarmed."""
    for entry in PROCESSES:
        if entry.robot == "follower" and entry.name not in NEEDS_KEYS:
            assert machine.is_active(unit_of(entry.name)), entry.name
            used = machine.must("readlink", f"/proc/{machine.show(unit_of(entry.name), 'MainPID')}/cwd")
            assert used.strip() == "/var/lib/davpc"
    with Probe(machine) as probe:
        until(probe.is_disarmed, PATIENCE_S, "the bridge to say disarmed")


def test_a_fresh_machine_has_everything_and_starts_nothing(machine: Machine, installed: Installed) -> None:
    assert "is installed for the follower (simulated)" in installed.said
    units = machine.must("systemctl", "list-unit-files", "--no-legend", "davpc*")
    for path in [*SYSTEMD.glob("davpc*.service"), *SYSTEMD.glob("davpc*.target")]:
        assert path.name in units
    assert not machine.is_active(TARGET)
    assert machine.must("stat", "-c", "%U %a", "/run/davpc").split() == ["davpc", "700"]
    listed = machine.must("davpc", "processes")
    assert all(entry.name in listed for entry in PROCESSES)


def test_a_second_install_and_a_dry_run_change_nothing(machine: Machine) -> None:
    before = snapshot(machine)
    assert "nothing changed" in machine.must(*install("v1", "follower"))
    planned = machine.must(*install("v2", "follower"), "--dry-run")
    assert "would run" in planned
    assert "9.0." in planned
    assert sorted(snapshot(machine) ^ before) == []


def doctor(machine: Machine, *well: str) -> dict[str, dict[str, str]]:
    """Findings of the doctor by check, once nothing has failed and what is named is well."""
    found: dict[str, dict[str, str]] = {}

    def settled() -> bool:
        said = machine.call("davpc", "doctor", "--json")
        assert said.returncode in (0, 1), said.stderr
        print(said.stdout)  # noqa: T201 - shown on failure
        found.update({finding["check"]: finding for finding in json.loads(said.stdout)["findings"]})
        return said.returncode == 0 and all(found[check]["status"] == "ok" for check in well)

    until(settled, PATIENCE_S, f"the doctor to find well: {', '.join(well)}")
    return found


def test_the_doctor_finds_an_installation_that_is_whole_and_stands(machine: Machine) -> None:
    installed = ("versions", "packages", "configuration", "real time", "units follower", "units leader")
    found = doctor(machine, *installed)
    assert "/opt/davpc/" in found["versions"]["seen"]
    assert found["configuration"]["seen"] == "/etc/davpc/robots.toml"
    assert "davpc-follower.target is stopped" in found["units follower"]["seen"]


@pytest.mark.stepped_twin("tests/stepped/test_sim.py::test_stepped_dockings_are_bit_identical")
def test_both_robots_of_a_bench_are_fit_says_the_doctor_and_dock_from_their_units(machine: Machine) -> None:
    machine.must("systemctl", "start", TARGET, "davpc-leader.target")
    doctor(machine, "drives", "Leader", "LEDs seen", "real time")
    dock(machine)
    machine.must("systemctl", "stop", "davpc-leader.target")


def test_an_upgrade_keeps_configuration_and_calibration_and_asks_before_it_stops_the_robot(machine: Machine) -> None:
    first = release(machine)
    config, calibration, taught = (
        machine.root / path
        for path in ("etc/davpc/robots.toml", "etc/davpc/calibration.toml", "var/lib/davpc/taught-1.json")
    )
    config.write_text(config.read_text() + _MINE)
    calibration.write_text(_MINE)
    taught.write_text(_MINE)

    refused = machine.call(*install("v2", "follower"), seconds=INSTALL_S)
    assert refused.returncode == 2
    assert "--restart" in refused.stderr
    assert release(machine) == first
    assert_healthy(machine)

    machine.must(*install("v2", "follower"), "--restart", seconds=INSTALL_S)
    assert release(machine).startswith("9.0.")
    assert release(machine, "previous") == first
    assert config.read_text().endswith(_MINE)
    assert calibration.read_text() == taught.read_text() == _MINE
    assert_healthy(machine)


def test_an_upgrade_that_is_not_healthy_is_taken_back(machine: Machine) -> None:
    good, before = release(machine), release(machine, "previous")
    failed = machine.call(*install("broken", "follower"), "--restart", seconds=INSTALL_S)
    assert failed.returncode != 0
    assert "not healthy: davpc-follower-camera.service" in failed.stderr
    assert f"release {good} is in use again" in failed.stderr
    assert (release(machine), release(machine, "previous")) == (good, before)
    assert_healthy(machine)


def test_a_release_that_cannot_read_the_configuration_is_not_switched_to(machine: Machine) -> None:
    config = machine.root / "etc/davpc/robots.toml"
    text, good = config.read_text(), release(machine)
    config.write_text(text + "\n[unknown]\nkey = 1\n")
    failed = machine.call(*install("v1", "follower"), "--restart", seconds=INSTALL_S)
    config.write_text(text)
    assert failed.returncode == 2
    assert "robots.toml: unknown: unknown key" in failed.stderr
    assert release(machine) == good
    assert_healthy(machine)


def test_one_command_goes_back_to_the_release_before(machine: Machine) -> None:
    newer, older = release(machine), release(machine, "previous")
    machine.must("/mnt/v2/deploy/install.sh", "rollback", seconds=INSTALL_S)
    assert (release(machine), release(machine, "previous")) == (older, newer)
    assert_healthy(machine)


def test_a_computer_that_runs_one_robot_does_not_become_the_other(machine: Machine) -> None:
    refused = machine.call(*install("v1", "leader"), "--restart", seconds=INSTALL_S)
    assert refused.returncode == 2
    assert f"'systemctl disable --now {TARGET}' first" in refused.stderr
    assert (machine.root / "etc/davpc/robot").read_text() == "follower simulated\n"
    assert_healthy(machine)


def test_on_hardware_can_comes_up_by_networkd_and_its_process_waits_for_it(machine: Machine) -> None:
    machine.must("systemctl", "stop", TARGET)
    config = machine.root / "etc/davpc/robots.toml"
    mine = config.read_text()
    config.unlink()
    machine.must("/mnt/v1/deploy/install.sh", "leader", "--wheels", "/media", seconds=INSTALL_S)
    template = load_config(config)
    assert {bus.interface for bus in (template.follower_can.bus, template.leader_can.bus)} == {"socketcan"}
    assert template.camera.driver == "mindvision"
    assert template.world == {}
    config.write_text(mine)

    assert "sys-subsystem-net-devices-can0.device" in machine.show("davpc-leader.service", "Requires")
    assert machine.is_active("systemd-networkd.service")
    assert machine.must("systemctl", "is-enabled", "systemd-networkd").strip() == "enabled"
    # they name a file of ours only to complain about it
    assert "80-davpc-can" not in machine.journal("-u", "systemd-networkd")
    link = machine.must("udevadm", "test-builtin", "net_setup_link", "/sys/class/net/lo")
    assert 'Parsed configuration file "/usr/local/lib/systemd/network/80-davpc-can.link"' in link
    assert "80-davpc-can.link:" not in link
    rules = machine.must("udevadm", "test", "/sys/class/net/lo")
    assert "Reading rules file: /usr/local/lib/udev/rules.d/70-davpc-camera.rules" in rules
    assert "70-davpc-camera.rules:" not in rules


def test_the_removal_leaves_what_is_yours_and_a_purge_leaves_nothing(machine: Machine) -> None:
    machine.must("/mnt/v1/deploy/install.sh", "uninstall")
    places = ("/etc", "/opt", "/run", "/usr", "/var/lib")
    found = machine.must("find", *places, "-xdev", "-name", "*davpc*").splitlines()
    left = {path for path in found if not Path(path).exists()}  # the host below may have some of its own
    kept = {"/etc/davpc", "/etc/davpc/davpc-drive-402.eds", "/etc/davpc/davpc-io-401.eds", "/var/lib/davpc"}
    assert left - {"/run/davpc-install.lock"} == kept  # what keeps two installers apart goes with the next boot
    assert (machine.root / "etc/davpc/robots.toml").read_text().endswith(_MINE)
    assert machine.must("systemctl", "list-units", "--all", "--no-legend", "davpc*").strip() == ""
    assert machine.must("stat", "-c", "%U", "/var/lib/davpc").strip() == "davpc"
    machine.must("/mnt/v1/deploy/install.sh", "uninstall", "--purge")
    assert machine.call("getent", "passwd", "davpc").returncode != 0
    assert not (machine.root / "etc/davpc").exists()
    assert not (machine.root / "var/lib/davpc").exists()
