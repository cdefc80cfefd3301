"""Checks of the computer: Python and packages, disk, clock, real-time permission, units."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from common.processes import Process
from station.doctor.findings import Finding, failed, ok, skipped, warning

LEAST_PYTHON = (3, 11)
_PIN = re.compile(r"^([A-Za-z0-9._-]+)(?:\[[^\]]*\])?==([^\s;\\]+)", re.MULTILINE)
_STEP_S = 0.05
_MB = 1e6
_NEW_SERVICE = "sudo systemctl reset-failed && sudo systemctl start"


def check_python(version: tuple[int, int, int], davpc: str, place: str) -> Finding:
    """Python's version, and which davpc this is."""
    text = f"Python {'.'.join(map(str, version))}, davpc {davpc} in {place}"
    if version[:2] < LEAST_PYTHON:
        return failed("versions", text, "davpc needs Python 3.11 or newer: install it again with one")
    return ok("versions", text)


def canonical(name: str) -> str:
    """A package's name as package indexes compare it (PEP 503)."""
    return re.sub(r"[-_.]+", "-", name).lower()


def locked_versions(lock: str) -> dict[str, set[str]]:
    """Versions that a lock file allows, by canonical name; several where it depends on the machine."""
    found: dict[str, set[str]] = {}
    for name, version in _PIN.findall(lock):
        found.setdefault(canonical(name), set()).add(version)
    return found


def check_packages(lock: str | None, installed: Mapping[str, str], needed: Sequence[str]) -> Finding:
    """What is installed against the lock, and what davpc needs against what is installed; canonical names."""
    missing = [name for name in needed if name not in installed]
    if missing:
        return failed(
            "packages", f"missing: {', '.join(missing)}", "install davpc again: deploy/install.sh, make setup"
        )
    if lock is None:
        return skipped("packages", "there is no lock file beside this davpc")
    locked = locked_versions(lock)
    wrong = [
        f"{name} {version} instead of {' or '.join(sorted(locked[name]))}"
        for name, version in sorted(installed.items())
        if name in locked and version not in locked[name]
    ]
    if wrong:
        return failed("packages", "; ".join(wrong), "install from the lock: deploy/install.sh, make setup")
    return ok("packages", f"{sum(name in locked for name in installed)} as locked")


def check_disk(check: str, path: str, free_bytes: int, least_mb: int, comfortable_mb: int) -> Finding:
    """Room where davpc keeps what outlives it, or its frames.

    Args:
        check: name of the finding.
        path: where.
        free_bytes: free there.
        least_mb: below that it fails.
        comfortable_mb: below that it warns.
    """
    text = f"{free_bytes / _MB:.0f} MB free in {path}"
    if free_bytes < least_mb * _MB:
        return failed(check, text, f"make room: at least {least_mb} MB, better {comfortable_mb}")
    if free_bytes < comfortable_mb * _MB:
        return warning(check, text, f"make room soon: below {least_mb} MB it fails")
    return ok(check, text)


def check_clock(synchronised: bool | None, stepped_s: float, now_s: float, newest_file_s: float) -> Finding:
    """Check the wall clock; only certificates depend on it, control uses the monotonic clock.

    Args:
        synchronised: as the machine reports it; None where it does not.
        stepped_s: by how much the wall clock moved against the monotonic one meanwhile.
        now_s: wall clock, seconds since 1970.
        newest_file_s: of davpc's own files, so that the true time lies after it.
    """
    if now_s < newest_file_s - 86_400.0:
        return failed("clock", "it is before davpc's own files", "set it: timedatectl set-time, or let NTP do so")
    if abs(stepped_s) > _STEP_S:
        return warning("clock", f"stepped by {stepped_s:+.2f} s meanwhile", "see who sets it: timedatectl, chronyc")
    if synchronised is None:
        return ok("clock", "steady; this machine cannot tell whether it is synchronised")
    if not synchronised:
        return warning("clock", "steady, not synchronised", "timedatectl set-ntp true, or certificates fail one day")
    return ok("clock", "steady and synchronised")


def check_realtime(
    running: Mapping[str, int | None], wanted: Mapping[str, int], allowed: bool, installed: bool
) -> Finding:
    """SCHED_FIFO of the processes that run, else whether they would get it.

    Args:
        running: FIFO priority by process, None for one that has another policy.
        wanted: priority by process, from the process table.
        allowed: this user may ask for real-time priorities.
        installed: units are here, whose priority the service manager gives.
    """
    without = [name for name, priority in running.items() if priority != wanted[name]]
    if without:
        text = f"without its priority: {', '.join(without)}"
        if installed:
            return failed(
                "real time", text, "start by units: systemctl start davpc-follower.target, davpc-leader.target"
            )
        return warning("real time", text, "loops may be late: allow it with ulimit -r 99 or as root, start again")
    if running:
        return ok("real time", f"{len(running)} processes under SCHED_FIFO")
    if installed:
        return ok("real time", "the units give it")
    if allowed:
        return ok("real time", "allowed")
    return warning("real time", "not allowed to this user", "a robot's units give it; on a laptop: ulimit -r 99")


@dataclass(frozen=True)
class UnitState:
    """What systemd reports of a unit: LoadState, ActiveState, Result, NRestarts."""

    load: str
    active: str
    result: str = "success"
    restarts: int = 0


def expected_units(processes: Sequence[Process]) -> list[str]:
    """Units of these processes."""
    return [f"davpc-{entry.name}.service" for entry in processes]


def check_units(robot: str, states: Mapping[str, UnitState] | None, safe: str) -> Finding:
    """Units of a robot, its target and the target of the safe stop, by name; no states where systemd does not run."""
    check, target = f"units {robot}", f"davpc-{robot}.target"
    if states is None:
        return skipped(check, "systemd does not run here")
    here = {name: state for name, state in states.items() if state.load == "loaded"}
    if target not in here:
        return skipped(check, f"{target} is not installed", "on a robot: deploy/install.sh")
    if safe in here and here[safe].active == "active":
        return failed(check, "in the safe stop", f"journalctl -t davpc-safe; then {_NEW_SERVICE} {target}")
    broken = [f"{name}: {state.result}" for name, state in here.items() if state.active == "failed"]
    if broken:
        return failed(check, "; ".join(broken), "journalctl -n 20 -u that unit")
    services = {name: state for name, state in here.items() if name.endswith(".service")}
    running = [name for name, state in services.items() if state.active == "active"]
    if here[target].active != "active":
        return ok(check, f"{len(services)} installed, {target} is stopped")
    idle = [name for name in services if name not in running]
    if any("gateway" not in name for name in idle):
        return failed(check, f"not running: {', '.join(idle)}", f"{_NEW_SERVICE} {target}")
    if idle:
        return warning(check, f"not running: {', '.join(idle)}", "a gateway needs certificates: deploy/pki.sh")
    restarted = [f"{name} ×{state.restarts}" for name, state in services.items() if state.restarts]
    if restarted:
        return warning(check, f"restarted: {', '.join(restarted)}", "journalctl -u that unit names the reason")
    return ok(check, f"{len(running)} run, none was restarted")
