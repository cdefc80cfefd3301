"""A workshop with trees of davpc to install, and the disk of a machine on which the first of them was installed."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from tests.deploy.machines import Machine, Network, why_not
from tests.deploy.units import ROOT

WHEELS = Path(os.environ.get("DAVPC_WHEELS", ROOT / "out/wheels"))
# long enough for a busy machine with two cores: what takes longer hangs
INSTALL_S = 600.0
HANGS_S = 900
_PARTS = ("common", "follower", "leader", "sim", "station", "experiments", "deploy", "docs")
_FILES = ("pyproject.toml", "README.md", "LICENSE")


def install(tree: str, *arguments: str) -> list[str]:
    """The command that installs from a tree of the workshop, out of the folder of wheels."""
    return [f"/mnt/{tree}/deploy/install.sh", *arguments, "--simulated", "--wheels", "/media"]


_MACHINES = pytest.StashKey[list[Machine]]()


@dataclass
class Workshop:
    """Makes trees, networks and machines, and leaves none behind."""

    folder: Path
    _networks: list[Network] = field(default_factory=list)
    machines: list[Machine] = field(default_factory=list)

    def tree(self, name: str, change: Callable[[Path], None] = lambda _: None) -> None:
        """A copy of this repository's tree that machines see as ``/mnt/NAME``."""
        tree = self.folder / "trees" / name
        for part in _PARTS:
            shutil.copytree(ROOT / part, tree / part, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
        for file in _FILES:
            shutil.copy(ROOT / file, tree)
        change(tree)

    def network(self, tag: str, machines: int) -> Network:
        """A namespace for each machine."""
        self._networks.append(Network(f"{os.getpid()}-{tag}", machines))
        return self._networks[-1]

    def machine(self, name: str, layers: Sequence[Path], space: str) -> Machine:
        """A machine that is off."""
        shared = {"/mnt": self.folder / "trees", "/media": WHEELS}
        self.machines.append(Machine(name, self.folder / name, layers, space, shared))
        return self.machines[-1]

    def close(self) -> None:
        """Everything away."""
        for machine in reversed(self.machines):
            machine.close()
        for network in self._networks:
            network.close()


@dataclass(frozen=True)
class Installed:
    """A disk with davpc on it, and what the installer said."""

    disk: Path
    said: str


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
