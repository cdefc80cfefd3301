"""The command line: every command is in the table, and only the one that is named gets imported."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from station.cli import COMMANDS, app

CLI: Any = typer.main.get_command(app)
NAMES = [name for names in COMMANDS.values() for name in names]


@pytest.mark.parametrize("name", NAMES)
def test_every_command_of_the_table_loads_and_has_an_example(name: str) -> None:
    command = CLI.commands[name]
    assert command.name == name
    assert f"davpc {name}" in command.help


def test_only_the_named_command_is_imported() -> None:
    script = "import sys; sys.argv = ['davpc', 'processes']; from station import cli\ntry: cli.main()\n"
    script += "finally: print(*(name for name in sys.modules if name.startswith('station.')), file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert set(done.stderr.split()) == {"station.cli", "station.operate", "station.operate.cli_processes"}


def test_a_mistyped_command_is_recognised() -> None:
    assert "Did you mean 'sim'?" in CliRunner().invoke(app, ["simm"]).output


def test_the_version_is_shown() -> None:
    assert CliRunner().invoke(app, ["--version"]).output.startswith("davpc ")


@pytest.mark.parametrize("name", ["wiring", "processes"])
def test_a_terminal_without_a_character_shows_another_in_its_place(name: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "station.cli", name],
        capture_output=True,
        env={**os.environ, "PYTHONIOENCODING": "iso-8859-1", "PYTHONUTF8": "0"},
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, b"")
    assert len(done.stdout) > 100


@pytest.mark.parametrize("name", ["wiring", "processes"])
def test_output_that_cannot_be_written_is_one_line(name: str) -> None:
    with Path("/dev/full").open("wb") as full:
        done = subprocess.run(
            [sys.executable, "-m", "station.cli", name], stdout=full, stderr=subprocess.PIPE, check=False
        )
    assert (done.returncode, done.stderr) == (2, b"davpc: output: cannot be written: No space left on device\n")
