"""The shipped units as systemd merges them: a unit file and the drop-ins that hold for its name."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).parents[2]
SYSTEMD = ROOT / "deploy/systemd"
VARIANTS = {"hardware": ROOT / "deploy/hardware", "simulated": ROOT / "deploy/simulated"}

Settings = dict[str, list[str]]


def unit_of(process: str) -> str:
    """The unit that runs this process."""
    return f"davpc-{process}.service"


def read(path: Path) -> Settings:
    """``Section.Key`` → its values in order, of one file; lines that end in a backslash go on."""
    found: Settings = defaultdict(list)
    section = ""
    for line in path.read_text().replace("\\\n", "").splitlines():
        if line.startswith("["):
            section = line.strip("[]")
        elif "=" in line and not line.startswith("#"):
            key, _, value = line.partition("=")
            found[f"{section}.{key}"].append(value)
    return found


def merged(unit: str) -> Settings:
    """A service's own file and then its drop-ins, those of its prefix among them, in the order of their names."""
    found: Settings = defaultdict(list)
    folders = (SYSTEMD / "davpc-.service.d", SYSTEMD / f"{unit}.d")
    drop_ins = [path for folder in folders if folder.is_dir() for path in folder.iterdir()]
    for path in (SYSTEMD / unit, *sorted(drop_ins, key=lambda path: path.name)):
        for key, values in read(path).items():
            found[key] += values
    return found


def words(settings: Settings, key: str) -> set[str]:
    """All words of a list-like key."""
    return {word for value in settings[key] for word in value.split()}
