"""A process that begins a new run is named once, by the newest header of its own channel."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from common.channels import ARM_STATE, COMMAND, DRIVES, Channel
from common.messages import Command, seal_command
from common.node import Inbox, Outbox
from common.timing import NS_PER_S
from follower.supervisor.run_watch import RunWatch
from tests.rigs.supervisor_rig import ARMS
from tests.rigs.supervisor_rig import DRIVES as MEASURED

COMMANDED = seal_command(Command(0.0, 0.0, 0, 1, 1, 1, 1, 1))
BOOT = "stepped"


class Watched:
    """A watch and what it looks at."""

    def __init__(self) -> None:
        self.watch, self.inbox = RunWatch(), Inbox(BOOT)
        self.now_ns = NS_PER_S

    def sent(self, channel: Channel[Any], message: Any, run_id: int, source: str = "") -> str:
        """Send once; the process that restarted."""
        self.now_ns += 1000
        sender = Outbox(source or channel.publisher, run_id, BOOT)
        self.inbox.put_state(channel, sender.pack(channel, message, self.now_ns), self.now_ns)
        self.inbox.begin_step()
        return self.watch.restarted(self.inbox)


@pytest.mark.parametrize(
    ("channel", "message"), [(DRIVES, replace(MEASURED, measured_ns=1)), (ARM_STATE, ARMS), (COMMAND, COMMANDED)]
)
def test_a_new_run_is_named_once(channel: Channel[Any], message: Any) -> None:
    watched = Watched()
    assert watched.watch.restarted(watched.inbox) == "", "nothing has arrived"
    assert watched.sent(channel, message, 1) == ""
    assert watched.sent(channel, message, 1) == ""
    assert watched.sent(channel, message, 2) == channel.publisher
    assert watched.sent(channel, message, 2) == ""
    assert watched.sent(channel, message, 1) == channel.publisher, "also one that comes back"


def test_commands_of_the_station_are_no_restart_of_the_controller() -> None:
    watched = Watched()
    assert watched.sent(COMMAND, COMMANDED, 1) == ""
    assert watched.sent(COMMAND, COMMANDED, 9, source="station") == ""
    assert watched.sent(COMMAND, COMMANDED, 1) == ""


def test_each_process_is_compared_with_itself() -> None:
    watched = Watched()
    assert watched.sent(DRIVES, replace(MEASURED, measured_ns=1), 1) == ""
    assert watched.sent(ARM_STATE, ARMS, 2) == ""
    assert watched.sent(ARM_STATE, ARMS, 3) == ARM_STATE.publisher
