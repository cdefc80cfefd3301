"""Listens to a robot in another machine: a session of ours in its private runtime directory."""

from __future__ import annotations

import threading
import time
from functools import partial
from pathlib import Path
from typing import Any

from common.bus import Bus
from common.channels import DRIVES, LEADER_STATE, MISSION, Channel, health_channel
from common.executor import earlier_processes
from common.messages import Header, Health, Message, decode
from common.processes import PROCESSES
from common.timing import MonotonicClock
from tests.deploy.machines import Machine


class Probe:
    """The newest message of each channel, with header and local time of receipt."""

    def __init__(self, machine: Machine) -> None:
        self._clock = MonotonicClock()
        self._newest: dict[str, tuple[Header, Any, float]] = {}
        self._lock = threading.Lock()
        runtime = Path("/proc", str(machine.pid), "root", "run/davpc")
        self._bus = Bus("probe", runtime, earlier_processes("probe"))
        channels: list[Channel[Any]] = [DRIVES, MISSION, LEADER_STATE]
        for channel in channels + [health_channel(entry.name) for entry in PROCESSES]:
            self._bus.subscribe(channel, partial(self._take, channel))

    def __enter__(self) -> Probe:
        return self

    def __exit__(self, *_: object) -> None:
        self._bus.close()

    def newest(self, channel: Channel[Any], max_age_s: float = 0.5) -> Message | None:
        """What came last, unless that is too long ago."""
        with self._lock:
            found = self._newest.get(channel.key)
        return found[1] if found and time.monotonic() - found[2] <= max_age_s else None

    def run_of(self, process: str) -> int:
        """Which run of a process was heard of last; 0 for none."""
        with self._lock:
            found = self._newest.get(health_channel(process).key)
        return found[0].run_id if found else 0

    def is_well(self, process: str) -> bool:
        """Whether it said within the last second that it is."""
        health = self.newest(health_channel(process), 1.2)
        return isinstance(health, Health) and health.ready

    def is_disarmed(self) -> bool:
        """Whether the bridge lives and no drive is under power."""
        drives: Any = self.newest(DRIVES)
        return drives is not None and drives.state == "disarmed"

    def phase(self) -> str:
        """Of the docking; with its cause."""
        mission: Any = self.newest(MISSION)
        return f"{mission.phase} {mission.cause}".strip() if mission else ""

    def _take(self, channel: Channel[Any], payload: bytes) -> None:
        header, message = decode(channel.message, payload)
        with self._lock:
            self._newest[channel.key] = (header, message, time.monotonic())
