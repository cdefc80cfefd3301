"""What ``davpc doctor`` receives of a running robot: a session that listens for a moment, and leaves nothing."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from common.channels import (
    DOCKING_STATE,
    DRIVES,
    FOLLOWER_GATEWAY,
    FRAME,
    LEADER_GATEWAY,
    LEADER_STATE,
    Channel,
    health_channel,
)
from common.errors import DeviceError
from common.messages import Frame, Health, Message, MessageError
from common.processes import PROCESSES
from station.operate.link import RobotLink, Stream

M = TypeVar("M", bound=Message)
_NEWEST: tuple[Channel[Any], ...] = (DOCKING_STATE, DRIVES, LEADER_STATE, FOLLOWER_GATEWAY, LEADER_GATEWAY)


@dataclass(frozen=True)
class RobotReport:
    """Which processes are alive, the newest message by key, and every note of a frame."""

    alive: frozenset[str] = frozenset()
    newest: Mapping[str, Any] = field(default_factory=dict)
    frames: tuple[Frame, ...] = ()

    def of(self, channel: Channel[M]) -> M | None:
        """The newest message of a channel, None if none came."""
        found: M | None = self.newest.get(channel.key)
        return found

    def health(self) -> dict[str, Health]:
        """By process."""
        reported = {entry.name: self.of(health_channel(entry.name)) for entry in PROCESSES}
        return {name: health for name, health in reported.items() if health is not None}


def listen(runtime: Path, namespace: str, seconds: float) -> RobotReport:
    """Listen to the robot whose sockets are in ``runtime``; an empty report if there are none.

    Raises:
        DeviceError: the folder belongs to another user.
        ConfigError: see :class:`common.bus.Bus`.
    """
    if not runtime.is_dir():
        return RobotReport()
    if not os.access(runtime, os.R_OK | os.W_OK | os.X_OK):
        raise DeviceError(f"{runtime} is not yours: sudo davpc doctor")
    if not any(runtime.glob("*.sock")):
        return RobotReport()
    channels = [*_NEWEST, *(health_channel(entry.name) for entry in PROCESSES)]
    with RobotLink(runtime, namespace) as link:
        watch, stream = link.watch(*channels), link.stream(FRAME)
        link.pause(seconds)
        newest = {channel.key: watch.newest(channel) for channel in channels}
        return RobotReport(frozenset(link.alive()), newest, tuple(_frames(stream)))


def _frames(stream: Stream) -> list[Frame]:
    found: list[Frame] = []
    while True:
        with contextlib.suppress(MessageError):  # of another version: as if it had not come
            item = stream.next(0.0)
            if item is None:
                return found
            found.append(item[2])
