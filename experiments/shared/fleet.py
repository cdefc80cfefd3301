"""Both robots and their world as real processes, with a station's connection: for experiments in real time."""

from __future__ import annotations

import contextlib
import secrets
import socket
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Literal

from common.bus import Bus
from common.channels import DOCK_REQUEST, LEADER_STATE, MISSION, health_channel
from common.config import load_config
from common.executor import earlier_processes
from common.messages import Answer, DockRequest, Health, LeaderState, Mission, decode
from common.node import Outbox
from common.processes import ONE_MACHINE
from common.timing import NS_PER_S, MonotonicClock
from experiments.shared.process import Starter, wait_for
from sim.world_message import WORLD, WorldState

READY_S = 40.0
_STATION = "station"
_MEMORY = Path("/dev/shm")


class Fleet:
    """All processes of a simulated run; a context manager that leaves none behind.

    Args:
        config_path: TOML file of the pair.
        logs: folder of the processes' logs.
        overrides: of the configuration, as ``table.key=value``.
    """

    def __init__(self, config_path: Path, logs: Path, overrides: Sequence[str] = ()) -> None:
        self._path, self._logs, self._overrides = config_path, logs, overrides
        self._stack = contextlib.ExitStack()
        self._clock = MonotonicClock()
        self.children: dict[str, subprocess.Popen[bytes]] = {}
        self.mission: Mission | None = None
        self.leader: LeaderState | None = None
        self.world: WorldState | None = None
        self.health: dict[str, Health] = {}

    def __enter__(self) -> Fleet:
        with contextlib.ExitStack() as stack:
            folder = tempfile.TemporaryDirectory(prefix="davpc-", dir=_MEMORY if _MEMORY.is_dir() else None)
            self.runtime = Path(stack.enter_context(folder))
            server = stack.enter_context(socket.create_server(("127.0.0.1", 0)))
            host, port = server.getsockname()
            self.address: tuple[str, int] = host, port
            buses = [f"{robot}_can.bus" for robot in ("follower", "leader")]
            overrides = [f'{bus}.host="{host}"' for bus in buses] + [f"{bus}.port={port}" for bus in buses]
            overrides += [f"world.can_server_fd={server.fileno()}", *self._overrides]
            self.config = load_config(self._path, overrides)
            self._starter = Starter(self._path, overrides, self.runtime, self._logs, (server.fileno(),))
            stack.callback(self._kill_all)
            self.start_missing()
            namespace = self.config.network.namespace
            self.bus = stack.enter_context(Bus(_STATION, self.runtime, earlier_processes(_STATION), namespace))
            self._outbox = Outbox(_STATION, secrets.randbits(62), self._clock.boot_id)
            self._listen()
            self.wait(self.all_alive, READY_S, "not every process is ready")
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def start_missing(self) -> None:
        """Start every process that does not run."""
        for entry in ONE_MACHINE:
            if entry.name not in self.children or self.children[entry.name].poll() is not None:
                self.children[entry.name] = self._starter.start(entry.name)

    def all_alive(self) -> bool:
        """Whether every process is declared alive on the bus."""
        return self.bus.alive() >= set(self.children)

    def ask(self, action: Literal["start", "abort", "reset"], trolley: int = 1) -> Answer | None:
        """Ask the supervisor; its answer, or None within a second."""
        now_ns = self._clock.now_ns()
        request = DockRequest(f"{action}-{secrets.token_hex(4)}", now_ns + 2 * NS_PER_S, action, trolley)
        reply = self.bus.request(DOCK_REQUEST, self._outbox.pack(DOCK_REQUEST, request, now_ns), 1.0)
        return decode(Answer, reply)[1] if reply is not None else None

    def wait(self, condition: Callable[[], bool], timeout_s: float, what: str) -> None:
        """Until a condition holds.

        Raises:
            DeviceError: it does not in time, or a process died; the text names the logs.
        """
        wait_for(condition, timeout_s, what, self.children, self._logs)

    def _listen(self) -> None:
        def mission(payload: bytes) -> None:
            self.mission = decode(Mission, payload)[1]

        def leader(payload: bytes) -> None:
            self.leader = decode(LeaderState, payload)[1]

        def world(payload: bytes) -> None:
            self.world = decode(WorldState, payload)[1]

        def health(payload: bytes) -> None:
            message = decode(Health, payload)[1]
            self.health[message.process] = message

        self.bus.subscribe(MISSION, mission)
        self.bus.subscribe(LEADER_STATE, leader)
        self.bus.subscribe(WORLD, world)
        for name in self.children:
            self.bus.subscribe(health_channel(name), health)

    def _kill_all(self) -> None:
        for child in self.children.values():
            child.kill()
            child.wait()
        self.children.clear()
