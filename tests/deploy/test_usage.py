"""A mistake on the installer's command line is one line that says what to do, and nothing is done."""

from __future__ import annotations

import subprocess

import pytest

from tests.deploy.units import ROOT

INSTALLER = ROOT / "deploy/install.sh"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((), "what to do?"),
        (("dance",), "what to do?"),
        (("follower", "--slowly"), "follower does not know --slowly"),
        (("follower", "leader"), "follower does not know leader"),
        (("follower", "--wheels"), "--wheels takes a folder"),
        (("rollback", "--start"), "rollback does not know --start"),
        (("uninstall", "--wheels", "out"), "uninstall does not know --wheels"),
        (("wheels",), "wheels takes the folder to put them into"),
        (("wheels", "--start"), "wheels takes the folder to put them into"),
        (("wheels", "out", "--start"), "wheels does not know --start"),
    ],
)
def test_a_mistake_is_one_line(arguments: tuple[str, ...], said: str) -> None:
    done = subprocess.run([INSTALLER, *arguments], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert len(done.stderr.splitlines()) == 1
    assert said in done.stderr


@pytest.mark.parametrize("arguments", [("--help",), ("-h",), ("follower", "--help"), ("wheels", "--help")])
def test_help_lists_every_command(arguments: tuple[str, ...]) -> None:
    done = subprocess.run([INSTALLER, *arguments], capture_output=True, text=True, check=False)
    assert done.returncode == 0
    for command in ("follower|leader", "rollback", "uninstall", "wheels DIR"):
        assert f"install.sh {command}" in done.stdout
