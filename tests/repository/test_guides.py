"""The guides say what there is: every command of davpc with its options, make targets, scripts, links, the wiring."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import typer

from common.config import Config, HomingConfig
from station.cli import app
from station.commission.wiring import wiring
from tests.rigs.guide_snippets import PREFIX, snippets

ROOT = Path(__file__).parents[2]
GUIDES = [ROOT / "README.md", ROOT / "ARCHITECTURE.md", ROOT / "CONTRIBUTING.md", *sorted(ROOT.glob("docs/*.md"))]
CLI = typer.main.get_command(app)
USAGE_ERROR: type[Exception] = typer.BadParameter.__mro__[1]  # click, or the copy of it that typer has
_LINK = re.compile(r"\]\(([^)#\s]+?)(?:#[^)]*)?\)")


def davpc_commands() -> list[tuple[str, str, bool]]:
    """Guide, words after ``davpc``, and whether they are to be typed as they are."""
    found = []
    for guide in GUIDES:
        for code, typed in snippets(guide.read_text(encoding="utf-8")):
            command = PREFIX.sub("", code)
            if command.startswith("davpc "):
                found.append((guide.name, command.removeprefix("davpc "), typed))
    return sorted(set(found))


class WrongCommandError(Exception):
    """What davpc would say to it."""


def check_command(words: list[str], typed: bool) -> None:
    """Nothing, if davpc knows the command and its options, and if typed takes their values too.

    Raises:
        WrongCommandError: it does not.
    """
    command: Any = CLI
    words = [word for word in words if word != "…"]
    while hasattr(command, "commands") and words and not words[0].startswith("-"):
        if words[0] not in command.commands:
            raise WrongCommandError(f"no command {words[0]!r}")
        command, words = command.commands[words[0]], words[1:]
    options = {text for parameter in command.params for text in (*parameter.opts, *parameter.secondary_opts)}
    for word in words:
        if word.startswith("--") and word.split("=")[0] not in {*options, "--help"}:
            raise WrongCommandError(f"no option {word}")
    if typed and not hasattr(command, "commands") and "--help" not in words:
        try:
            command.make_context("davpc", list(words))
        except USAGE_ERROR as error:
            raise WrongCommandError(str(error)) from error


def test_the_check_itself_notices() -> None:
    check_command(["dock", "start", "--trolley", "2"], True)
    check_command(["teach", "K"], False)
    for words, typed in (
        (["dance"], False),
        (["dock", "dance"], False),
        (["dock", "start", "--slowly"], False),
        (["dock", "start", "--trolley", "many"], True),
        (["dock", "start", "now"], True),
        (["teach"], True),
    ):
        with pytest.raises(WrongCommandError):
            check_command(words, typed)


def test_snippets_are_found() -> None:
    text = "Run `davpc can\nscan` or:\n\n    sudo davpc doctor   # look\n\n1. so:\n\n       davpc led status\n"
    assert list(snippets(text)) == [
        ("sudo davpc doctor", True),
        ("davpc led status", True),
        ("davpc can scan", False),
    ]


@pytest.mark.parametrize(("guide", "words", "typed"), davpc_commands())
def test_every_command_in_the_guides_exists(guide: str, words: str, typed: bool) -> None:
    try:
        check_command(shlex.split(words), typed and not re.search(r"[…]|\b[A-Z]{2,}\b", words))
    except WrongCommandError as error:
        pytest.fail(f"{guide}: davpc {words}: {error}")


def test_make_targets_and_scripts_in_the_guides_exist() -> None:
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    seen = 0
    for guide in GUIDES:
        for code, _ in snippets(guide.read_text(encoding="utf-8")):
            words = PREFIX.sub("", code).split()
            if words[0] == "make" and len(words) > 1:
                assert words[1] in targets, f"{guide.name}: {code}"
                seen += 1
            elif words[0].startswith("deploy/") and words[0].endswith(".sh"):
                assert (ROOT / words[0]).is_file(), f"{guide.name}: {code}"
                seen += 1
    assert seen > 5


def test_links_lead_somewhere() -> None:
    for guide in GUIDES:
        for link in _LINK.findall(guide.read_text(encoding="utf-8")):
            assert "://" in link or (guide.parent / link).exists(), f"{guide.name}: {link}"


def test_the_wiring_in_the_guide_is_the_configurations(config: Config) -> None:
    text = (ROOT / "docs/bring-up.md").read_text(encoding="utf-8")
    found = text.partition("<!-- davpc wiring -->")[2].partition("<!-- end -->")[0].strip()
    assert found == wiring(config), "docs/bring-up.md: put the output of davpc wiring between its marks"


def test_the_wiring_names_every_node(config: Config) -> None:
    text = wiring(config)
    can = config.follower_can
    for node_id in (*(drive.node_id for drive in can.drives), can.io_node_id, config.leader_can.io_node_id):
        assert f"| {node_id} |" in text
    homing = HomingConfig(method=17, position=0.0, search_speed=0.1, zero_speed=0.1, acceleration=1.0)
    lift = can.lift.model_copy(update={"homing": homing, "node_id": 31})
    other = config.model_copy(update={"follower_can": can.model_copy(update={"lift": lift})})
    assert "| 31 | lift | 1 | 0.5 | 65536 | +1 | homing, method 17 |" in wiring(other)
