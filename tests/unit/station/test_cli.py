"""The command line: every command is in the table, and only the one that is named gets imported."""

from __future__ import annotations

import subprocess
import sys
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
