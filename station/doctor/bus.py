"""What ``davpc doctor`` hears of a running robot: a session that listens for a moment, and leaves nothing."""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from common.bus import Bus
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
from common.executor import earlier_processes
from common.messages import Frame, Health, Message, MessageError, decode
from common.processes import PROCESSES
from common.timing import NS_PER_S, MonotonicClock

M = TypeVar("M", bound=Message)
_NEWEST: tuple[Channel[Any], ...] = (DOCKING_STATE, DRIVES, LEADER_STATE, FOLLOWER_GATEWAY, LEADER_GATEWAY)


@dataclass(frozen=True)
class Heard:
    """Who showed that he lives, the newest message by key, and every note of a frame."""

    alive: frozenset[str] = frozenset()
    newest: Mapping[str, Any] = field(default_factory=dict)
    frames: tuple[Frame, ...] = ()

    def of(self, channel: Channel[M]) -> M | None:
        """The newest message of a channel, None if none came."""
        found: M | None = self.newest.get(channel.key)
        return found

    def health(self) -> dict[str, Health]:
        """By process."""
        told = {entry.name: self.of(health_channel(entry.name)) for entry in PROCESSES}
        return {name: health for name, health in told.items() if health is not None}


def listen(runtime: Path, namespace: str, seconds: float) -> Heard:
    """Listen to the robot whose sockets lie in ``runtime``; nothing heard if there are none.

    Raises:
        DeviceError: the folder is somebody else's.
        ConfigError: see :class:`common.bus.Bus`.
    """
    if not runtime.is_dir():
        return Heard()
    if not os.access(runtime, os.R_OK | os.W_OK | os.X_OK):
        raise DeviceError(f"{runtime} is not yours: sudo davpc doctor")
    if not any(runtime.glob("*.sock")):
        return Heard()
    name, clock = f"doctor-{os.getpid()}", MonotonicClock()
    channels = [*_NEWEST, *(health_channel(entry.name) for entry in PROCESSES)]
    newest: dict[str, Any] = {}
    frames: list[Frame] = []
    lock = threading.Lock()

    def receiver(channel: Channel[Any]) -> Callable[[bytes], None]:
        def receive(payload: bytes) -> None:
            with contextlib.suppress(MessageError):  # of another version: as if it had not come
                message = decode(channel.message, payload)[1]
                with lock:
                    newest[channel.key] = message
                    if isinstance(message, Frame):
                        frames.append(message)

        return receive

    try:
        with Bus(name, runtime, earlier_processes(name), namespace) as bus:
            for channel in channels:
                bus.subscribe(channel, receiver(channel))
            bus.stream(FRAME, receiver(FRAME))
            clock.sleep_until(clock.now_ns() + round(seconds * NS_PER_S))
            alive = frozenset(bus.alive())
    finally:
        for path in runtime.glob(f"{name}.*"):
            path.unlink(missing_ok=True)
    with lock:
        return Heard(alive, dict(newest), tuple(frames))
