"""A docking of a robot in another machine, repeated only if the host itself stood still."""

from __future__ import annotations

from collections.abc import Callable

from tests.deploy.machines import PATIENCE_S, Machine, until
from tests.deploy.probe import Probe
from tests.rigs.host import judged_on_a_calm_host

TARGET = "davpc-follower.target"
DOCKED_S = 120.0


def ask(machine: Machine) -> None:
    """Ask for a docking, as an operator on the robot does.

    nspawn hides the machine's boot id behind one of its own, which units with a /proc of their own do not see.
    """
    asker = ("systemd-run", "--quiet", "--pipe", "--wait", "--uid=davpc", "--property=ProtectProc=invisible")
    machine.must(*asker, "/usr/local/bin/davpc", "dock", "start")


def dock(machine: Machine, on_approach: Callable[[Probe], None] = lambda _: None) -> None:
    """Dock from the world's start to the end, with ``on_approach`` under way; fails unless it is done."""
    tries = 0

    def attempt() -> None:
        nonlocal tries
        tries += 1
        if tries > 1:
            machine.must("systemctl", "restart", TARGET)
            until(lambda: machine.is_active(TARGET), PATIENCE_S, "the Follower after a restart")
        with Probe(machine) as probe:
            ended = _dock_once(machine, probe, on_approach)
        assert ended.startswith("done"), f"the docking ended as: {ended}"

    judged_on_a_calm_host(attempt)


def _dock_once(machine: Machine, probe: Probe, on_approach: Callable[[Probe], None]) -> str:
    until(lambda: probe.is_disarmed() and probe.is_well("world"), PATIENCE_S, "the bridge to say disarmed")
    until(lambda: probe.is_well("leader"), PATIENCE_S, "the Leader to be heard")
    ask(machine)
    until(lambda: probe.phase().split(" ")[0] not in ("", "idle", "acquire"), PATIENCE_S, "the docking to begin")
    if probe.phase() == "approach":
        on_approach(probe)
    until(lambda: probe.phase().split(" ")[0] in ("done", "aborted"), DOCKED_S, "the docking to end")
    return probe.phase()
