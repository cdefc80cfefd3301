"""A workshop with trees of davpc to install, and the disk of a machine on which the first of them was installed."""

from __future__ import annotations

import os
import subprocess
import tempfile
from collections.abc import Generator, Iterator
from pathlib import Path

import pytest

from tests.deploy.machines import Machine, why_not
from tests.deploy.workshop import INSTALL_S, WHEELS, Installed, Workshop, install

_MACHINES = pytest.StashKey[list[Machine]]()


@pytest.fixture(scope="session")
def workshop(request: pytest.FixtureRequest) -> Iterator[Workshop]:
    """Skips with the reason where machines cannot be booted."""
    folder = Path(tempfile.mkdtemp(prefix="davpc-deploy-"))
    reason = why_not(folder)
    try:
        if not reason and not any(WHEELS.glob("*.whl")):
            reason = f"no packages in {WHEELS}: run `make wheels` first"
        if reason:
            pytest.skip(reason)
        made = Workshop(folder)
        request.session.stash[_MACHINES] = made.machines
        try:
            yield made
        finally:
            made.close()
    finally:
        if os.path.ismount(folder):
            subprocess.run(["umount", folder], check=True)
        folder.rmdir()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Show with a failure what its machines logged last."""
    report = yield
    for machine in item.session.stash.get(_MACHINES, []):
        if report.failed and machine.pid:
            report.sections.append(
                (f"journal of {machine.name}", machine.journal("-n", "60", "-o", "short-monotonic"))
            )
    return report


@pytest.fixture(scope="session")
def installed(workshop: Workshop) -> Installed:
    """Install on a fresh machine without a network; the others start from its disk."""
    workshop.tree("v1")
    fresh = workshop.machine("fresh", [], workshop.network("fresh", 1).spaces[0])
    fresh.boot()
    said = fresh.must(*install("v1", "follower"), seconds=INSTALL_S)
    fresh.cut_power()
    return Installed(fresh.disk, said)
