"""Every command that README.md offers runs to its end, in its smallest form."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import typer

from station.cli import app
from tests.rigs.guide_snippets import PREFIX, snippets

ROOT = Path(__file__).parents[2]
CLI: Any = typer.main.get_command(app)
TIMEOUT_S = 540
NO_ROBOT = "no robot runs here"
ALL = "README_COMMANDS"


@dataclass(frozen=True)
class Small:
    """A smallest form, and how it ends. A command for a robot says in one line that there is none.

    A ``long`` one takes minutes: ``make readme`` runs it too.
    """

    words: str
    says: str = ""
    exit_code: int = 0
    long: bool = False


STEPPED = "--stepped --headless"
SMALLEST = {
    "sim --start 8,1,-30": Small(f"sim --start 8,1,-30 {STEPPED}"),
    "sim --stepped --seed 7": Small(f"sim --seed 7 {STEPPED}"),
    "sim --stepped --record": Small(f"sim --record --start 4,-1,45 {STEPPED}"),
    "sim --trolleys 8": Small(f"sim --trolleys 1 --start 4,-1,45 {STEPPED}"),
    "sim --config my.toml": Small(f"sim --config my.toml --start 4,-1,45 {STEPPED}"),
    "sim --set controller.method='paper_fatrop' --set estimator.method='paper'": Small(
        "sim --set controller.method='paper_fatrop' --set estimator.method='paper' --start 4,-1,45 " + STEPPED,
        long=True,
    ),
    "sim --scene glass_hall": Small(f"sim --scene glass_hall --start 4,-1,45 {STEPPED}"),
    "experiment table1": Small("experiment table1 --trials 1", long=True),
    "experiment trajectories": Small("experiment trajectories", long=True),
    "experiment disturbance": Small("experiment disturbance --trials 1", long=True),
    "experiment sweep": Small("experiment sweep --trials 1", long=True),
    "experiment tune": Small("experiment tune --methods ibvs --evaluations 1 --trials 1"),
    "experiment sequential": Small("experiment sequential --trials 1 --trolleys 1", long=True),
    "experiment scenarios": Small("experiment scenarios --trials 1", long=True),
    "experiment incidents": Small("experiment incidents --trials 1 --cases hidden_led", long=True),
    "experiment linkcut": Small("experiment linkcut --trials 1", long=True),
    "experiment campaign --seeds 2": Small("experiment campaign --seeds 1 --rows S22", long=True),
    "experiment fuzz --messages 300000": Small("experiment fuzz --messages 200 --frames 200 --files 2", long=True),
    "experiment load": Small("experiment load --seconds 1 --cases nothing", long=True),
    "experiment soak --hours 24": Small("experiment soak --hours 0.01", long=True),
    "experiment tolerance": Small(
        "experiment tolerance --robots 1 --methods geometry --cases focal_length --no-sensitivities", long=True
    ),
    "bench recording": Small("bench recording --pairs 1", long=True),
    "replay": Small("replay missing.mcap", "missing.mcap", 2),
    "report last --html page.html": Small("report last --html page.html --state .", "no recordings", 2),
    "bench control": Small("bench control --problems 10"),
    "bench perception": Small("bench perception --rounds 10"),
    "bench can": Small("bench can --cycles 100"),
    "jog": Small("jog --speed 0.05", NO_ROBOT, 3),
    "grip open": Small("grip open", NO_ROBOT, 3),
    "lift 200": Small("lift 200", NO_ROBOT, 3),
    "run follower-can-bridge --shadow": Small("run follower-can-bridge --shadow", "no such folder", 2),
    "run follower-can-bridge --readonly": Small("run follower-can-bridge --readonly", "no such folder", 2),
    "can monitor": Small("can monitor", "no socketcand server", 3),
    "dock status": Small("dock status", NO_ROBOT, 1),
    "dock abort": Small("dock abort", NO_ROBOT, 1),
    "led status": Small("led status", NO_ROBOT, 1),
    "lock status": Small("lock status", NO_ROBOT, 1),
    "doctor": Small("doctor"),
    "--help": Small("--help"),
}


def offered() -> Iterator[str]:
    """Commands of README.md; names of sub-commands alone belong to the command before them."""
    group: Any = None
    for code, _ in snippets((ROOT / "README.md").read_text(encoding="utf-8")):
        words = PREFIX.sub("", code).split()
        if words[0] == "davpc" and len(words) > 1:
            group = CLI.commands.get(words[1])
            if words[1:] != ["sim"]:
                yield " ".join(words[1:])
        elif len(words) == 1 and words[0] in getattr(group, "commands", {}):
            yield f"{group.name} {words[0]}"


def test_every_command_of_the_readme_has_a_smallest_form() -> None:
    assert set(offered()) == set(SMALLEST)
    for command, small in SMALLEST.items():
        assert small.words.split()[0] == command.split()[0]


@pytest.mark.alone
@pytest.mark.timeout(TIMEOUT_S + 60)
@pytest.mark.parametrize("command", SMALLEST)
def test_a_command_of_the_readme_runs_to_its_end(command: str, tmp_path: Path, config_path: Path) -> None:
    shutil.copytree(config_path.parent, tmp_path / "config")
    shutil.copy(config_path, tmp_path / "config/my.toml")
    small = SMALLEST[command]
    if small.long and not os.environ.get(ALL):
        pytest.skip("takes minutes: make readme")
    environment = {name: value for name, value in os.environ.items() if not name.startswith("DAVPC_")}
    ended = subprocess.run(
        [sys.executable, "-m", "station.cli", *shlex.split(small.words)],
        cwd=tmp_path / "config",
        env=environment | {"PYTHONPATH": str(ROOT), "COLUMNS": "200"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        check=False,
    )
    said = ended.stdout + ended.stderr
    assert "Traceback" not in said
    assert ended.returncode == small.exit_code, said[-2000:]
    assert small.says in said
