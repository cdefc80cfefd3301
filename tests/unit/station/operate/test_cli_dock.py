"""What commands to running robots say and send, without a robot."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any

import pytest
from typer.testing import CliRunner

from common.messages import Answer
from station.cli import app
from station.operate import cli_dock, cli_leader


class PlayedLink:
    """Accepts everything."""

    now_ns = 1

    def __init__(self) -> None:
        self.asked: list[Any] = []

    def ask(self, _channel: Any, request: Any, _patience_s: float) -> Answer:
        self.asked.append(request)
        return Answer(request.id, "accepted", "so be it")


@pytest.fixture
def link(monkeypatch: pytest.MonkeyPatch) -> PlayedLink:
    played = PlayedLink()

    @contextlib.contextmanager
    def opened(*_: Any) -> Iterator[PlayedLink]:
        yield played

    for module in (cli_dock, cli_leader):
        monkeypatch.setattr(module, "open_link", opened)
    return played


def test_ctrl_c_while_waiting_names_what_goes_on(link: PlayedLink, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(cli_dock, "_ended", interrupted)
    ended = CliRunner().invoke(app, ["dock", "start", "--wait"])
    assert ended.exit_code == 130
    assert "the docking goes on" in ended.output
    assert "davpc dock abort" in ended.output
    assert [request.action for request in link.asked] == ["start"]


@pytest.mark.parametrize("command", [("open",), ("count", "3")])
def test_what_is_not_confirmed_is_not_asked(link: PlayedLink, command: tuple[str, ...]) -> None:
    ended = CliRunner().invoke(app, ["lock", *command], input="n\n")
    assert (ended.exit_code, link.asked) == (1, [])
    assert "nothing was asked" in ended.output


def test_what_is_confirmed_is_asked(link: PlayedLink) -> None:
    assert CliRunner().invoke(app, ["lock", "open"], input="y\n").exit_code == 0
    (request,) = link.asked
    assert (request.action, request.confirmed) == ("unlock", True)
