"""A docking of a robot in another machine, repeated only if the host itself stood still."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests.deploy.machines import PATIENCE_S, Machine, until
from tests.deploy.probe import Probe
from tests.host import HostWatch, cannot_judge

TARGET = "davpc-follower.target"
DOCKED_S = 120.0
_TRIES = 3
# so many periods of 1/60 s in which the simulated drives did not run: the bridge calls them silent, rightly
_STALL_PERIODS = 3


def ask(machine: Machine) -> None:
    """Ask for a docking, as a person on the robot does.

    nspawn hides the machine's boot id behind one of its own, which units with a /proc of their own do not see.
    """
    asker = ("systemd-run", "--quiet", "--pipe", "--wait", "--uid=davpc", "--property=ProtectProc=invisible")
    machine.must(*asker, "/usr/local/bin/davpc", "dock", "start")


def dock(machine: Machine, on_approach: Callable[[Probe], None] = lambda _: None) -> None:
    """Dock from the world's start to the end, with ``on_approach`` under way; fails unless it is done."""
    hosts: list[HostWatch] = []
    for attempt in range(1, _TRIES + 1):
        with Probe(machine) as probe, HostWatch() as host:
            hosts.append(host)
            ended, stalled = _dock_once(machine, probe, on_approach)
        if ended.startswith("done"):
            return
        if not stalled and not host.stood_still():
            pytest.fail(f"the docking ended as: {ended}")
        if attempt == _TRIES:
            cannot_judge(hosts)
            pytest.fail(f"the docking ended as: {ended}")
        machine.must("systemctl", "restart", TARGET)
        until(lambda: machine.is_active(TARGET), PATIENCE_S, "the Follower after a restart")


def _dock_once(machine: Machine, probe: Probe, on_approach: Callable[[Probe], None]) -> tuple[str, bool]:
    until(lambda: probe.is_disarmed() and probe.is_well("world"), PATIENCE_S, "the bridge to say disarmed")
    until(lambda: probe.is_well("leader"), PATIENCE_S, "the Leader to be heard")
    missed, stood_still = probe.missed("world"), _stalls(machine)
    ask(machine)
    until(lambda: probe.phase().split(" ")[0] not in ("", "idle", "acquire"), PATIENCE_S, "the docking to begin")
    if probe.phase() == "approach":
        on_approach(probe)
    until(lambda: probe.phase().split(" ")[0] in ("done", "aborted"), DOCKED_S, "the docking to end")
    stalled = probe.missed("world") - missed >= _STALL_PERIODS or _stalls(machine) > stood_still
    return probe.phase(), stalled


def _stalls(machine: Machine) -> int:
    """How often the bridge said that it had itself stood still."""
    return machine.journal("-u", "davpc-follower-can-bridge").count("stood still")
