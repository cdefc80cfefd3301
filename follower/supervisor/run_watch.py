"""Which process began a new run: a docking is never resumed after a restart."""

from __future__ import annotations

from typing import Any, Final

from common.channels import ARM_STATE, COMMAND, DOCKING_STATE, DRIVES, FRAME, Channel
from common.node import Inbox

_WATCHED: Final[tuple[Channel[Any], ...]] = (FRAME, DOCKING_STATE, DRIVES, ARM_STATE, COMMAND)


class RunWatch:
    """Compares the run in the newest header of each channel.

    In ``manual`` the station publishes the commands instead of the controller: a header from any other publisher
    than the channel's own is ignored.
    """

    def __init__(self) -> None:
        self._runs: dict[str, int] = {}

    def restarted(self, inputs: Inbox) -> str:
        """The process that restarted since the last call, or empty."""
        found = ""
        for channel in _WATCHED:
            newest = inputs.newest(channel)
            if newest is None or newest.header.source != channel.publisher:
                continue
            before = self._runs.get(channel.key)
            self._runs[channel.key] = newest.header.run_id
            if before is not None and before != newest.header.run_id:
                found = channel.publisher
        return found
