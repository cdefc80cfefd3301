"""Both robots and their world as real processes, with a station's connection: for experiments in real time."""

from __future__ import annotations

import contextlib
import math
import secrets
import socket
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Literal

from common.bus import Bus
from common.channels import DOCK_REQUEST, DRIVES, LEADER_STATE, MISSION, Channel, health_channel
from common.config import BusConfig, load_config
from common.executor import earlier_processes
from common.messages import Answer, DockRequest, Drives, Health, LeaderState, MessageError, Mission, decode
from common.node import Outbox
from common.processes import ONE_MACHINE, PROCESSES, process
from common.timing import NS_PER_S, MonotonicClock
from experiments.shared.operator import Operator
from experiments.shared.process import Starter, wait_for
from experiments.stop_times.watch import BusTap
from gateway.access import OTHER
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
        credentials: folder of the gateways' certificates: each robot has a mesh of its own, as on two
            computers; None: both share one, without gateways.
    """

    def __init__(
        self, config_path: Path, logs: Path, overrides: Sequence[str] = (), credentials: Path | None = None
    ) -> None:
        self._path, self._logs, self._overrides = config_path, logs, overrides
        self._credentials = credentials
        self.ports: dict[str, int] = {}
        self._stack = contextlib.ExitStack()
        self._clock = MonotonicClock()
        self.children: dict[str, subprocess.Popen[bytes]] = {}
        self.mission: Mission | None = None
        self.leader: LeaderState | None = None
        self.world: WorldState | None = None
        self.drives: Drives | None = None
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
            overrides += [f"world.can_server_fd={server.fileno()}", *self._network(), *self._overrides]
            self.config = load_config(self._path, overrides)
            other = self.runtime / "leader" if self._credentials else self.runtime
            other.mkdir(mode=0o700, exist_ok=True)
            self._starters = {
                robot: Starter(self._path, overrides, folder, self._logs, (server.fileno(),))
                for robot, folder in (("follower", self.runtime), ("leader", other), ("world", self.runtime))
            }
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
        for entry in PROCESSES if self._credentials else ONE_MACHINE:
            if entry.name not in self.children or self.children[entry.name].poll() is not None:
                self.children[entry.name] = self._starters[entry.robot].start(entry.name)

    def start(self, name: str) -> None:
        """Start one more process of the table; it ends with the others."""
        self.children[name] = self._starters[process(name).robot].start(name)

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

    def _network(self) -> list[str]:
        """Overrides for gateways on loopback."""
        if self._credentials is None:
            return []
        self.ports = {robot: _free_port() for robot in OTHER}
        return [f'network.credentials="{self._credentials}"'] + [
            f'network.{robot}.{way}=["quic/127.0.0.1:{port}"]'
            for robot, other in OTHER.items()
            for way, port in (("listen", self.ports[robot]), ("connect", self.ports[other]))
        ]

    def operate(self, operator: Operator, now_s: float) -> None:
        """Carry out what an operator wants at ``now_s`` of the experiment."""
        action = operator.step(now_s, self.mission, self.leader)
        if action is not None:
            answer = self.ask(action, operator.trolley)
            operator.answered(now_s, action, answer is not None and answer.outcome in ("accepted", "done"))

    def tap(self, priority: int) -> BusTap:
        """Another client of the Follower's bus, to be closed by the caller."""
        can, (host, port) = self.config.follower_can, self.address
        bus = BusConfig(interface="socketcand", channel=can.bus.channel, host=host, port=port)
        return BusTap(bus, (can.left_wheel.node_id, can.right_wheel.node_id), priority)

    def wheel_m_s(self, counts: float) -> float:
        """Speed of a wheel's rim at so many encoder counts per second."""
        wheel = self.config.follower_can.left_wheel
        return counts * 2 * math.pi * self.config.base.wheel_radius_m / (wheel.counts_per_turn * wheel.gear_ratio)

    def _listen(self) -> None:
        for name, channel in (("mission", MISSION), ("leader", LEADER_STATE), ("world", WORLD), ("drives", DRIVES)):
            self._follow(channel, partial(setattr, self, name))
        for name in self.children:
            self._follow(health_channel(name), partial(self.health.__setitem__, name))

    def _follow(self, channel: Channel[Any], take: Callable[[Any], None]) -> None:
        """Take each valid message; an experiment may also send others."""

        def receive(payload: bytes) -> None:
            with contextlib.suppress(MessageError):
                take(decode(channel.message, payload)[1])

        self.bus.subscribe(channel, receive)

    def _kill_all(self) -> None:
        for child in self.children.values():
            child.kill()
            child.wait()
        self.children.clear()


def _free_port() -> int:
    """A UDP port that is free."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.bind(("127.0.0.1", 0))
        return int(link.getsockname()[1])
