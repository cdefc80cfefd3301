"""A workshop with trees of davpc to install, and the machines on which that is done."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from tests.deploy.machines import Machine, Network
from tests.deploy.units import ROOT

WHEELS = Path(os.environ.get("DAVPC_WHEELS", ROOT / "out/wheels"))
# long enough for a busy machine with two cores: what takes longer hangs
INSTALL_S = 600.0
HANGS_S = 900
_PARTS = ("common", "follower", "gateway", "leader", "sim", "station", "experiments", "deploy", "docs")
_FILES = ("pyproject.toml", "README.md", "LICENSE")


def install(tree: str, *arguments: str) -> list[str]:
    """The command that installs from a tree of the workshop, out of the folder of wheels."""
    return [f"/mnt/{tree}/deploy/install.sh", *arguments, "--simulated", "--wheels", "/media"]


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
