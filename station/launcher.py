"""Runs one docking of both robots against the simulated backend: as processes, or stepped in this one.

The only place outside experiments and tests that knows the simulated backend by name.
"""

from __future__ import annotations

import contextlib
import os
import queue
import secrets
import socket
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from common.bus import Bus
from common.channels import DOCK_REQUEST, Channel
from common.config import Config, ConfigError, load_config
from common.executor import earlier_processes
from common.geometry import Pose2
from common.messages import Answer, DockRequest, Header, MessageError, decode, encode
from common.node import Inbox, Node, NodeContext, Output, Trigger
from common.processes import GATEWAYS, ONE_MACHINE, PROCESSES
from common.timing import NS_PER_MS, NS_PER_S, MonotonicClock, SteppedClock
from sim.stepped import SteppedExecutor
from sim.world_config import WorldConfig, world_config
from sim.world_message import WORLD, WorldState
from station import report
from station.children import (
    Absence,
    Children,
    death,
    interruptible,
    listening_socket,
    runtime_directory,
    start_children,
    stop_children,
)
from station.record import DockingRecord, TrueSample

STATION = "station"
LOGS = "logs"
READY_TIMEOUT_S = 40.0
RUN_TIMEOUT_S = 150.0
_AFTER_DEATH_NS = 1_500 * NS_PER_MS
Progress = Callable[[DockingRecord], None]


@dataclass
class Run:
    """One docking to run: configuration file, overrides, and where to put the logs."""

    config_path: Path
    overrides: list[str]
    out: Path
    progress: Progress = lambda _record: None
    config: Config = field(init=False)
    world: WorldConfig = field(init=False)

    def __post_init__(self) -> None:
        """Read and check everything, and make the folder empty of an earlier run's results.

        Raises:
            ConfigError: a mistake in the configuration, or ``out`` cannot be written to.
        """
        self.config = load_config(self.config_path, self.overrides)
        self.world = world_config(self.config, str(self.config_path))
        try:
            (self.out / LOGS).mkdir(parents=True, exist_ok=True)
            for name in report.OUTPUTS:
                (self.out / name).unlink(missing_ok=True)
            (self.out / report.OUTPUTS[0]).touch()
            (self.out / report.OUTPUTS[0]).unlink()
        except OSError as error:
            raise ConfigError(f"--out {self.out}: cannot be written to: {error.strerror}") from error


def true_sample(world: WorldState) -> TrueSample:
    """The part of the world that a record keeps."""
    return TrueSample(world.time_ns, Pose2(world.x_m, world.y_m, world.theta_rad), world.v_m_s, world.w_rad_s)


# --- stepped


class _StationNode(Node):
    """Asks for the docking and records it, in stepped time."""

    name = STATION
    inputs = (*DockingRecord.CHANNELS, WORLD)
    outputs = (DOCK_REQUEST,)
    trigger = Trigger(period_ns=NS_PER_S // 10, wakes=(*DockingRecord.CHANNELS, WORLD))

    def __init__(self, record: DockingRecord, start_ns: int) -> None:
        self._record = record
        self._start_ns = start_ns
        self._asked = False

    def step(self, now_ns: int, inputs: Inbox) -> Sequence[Output]:
        for channel in DockingRecord.CHANNELS:
            if inputs.arrived(channel) is not None:
                received = inputs.newest(channel)
                assert received is not None
                self._record.take(channel, received.message, received.header.stamp_ns)
        world = inputs.arrived(WORLD)
        if world is not None:
            self._record.take_truth(true_sample(world))
        if not self._asked and now_ns >= self._start_ns:
            self._asked = True
            return ((DOCK_REQUEST, DockRequest("stepped-start", now_ns + 10 * NS_PER_S, "start")),)
        return ()


def run_stepped(run: Run) -> tuple[DockingRecord, str]:
    """One docking in stepped time, in this process; the record and what ended it early."""
    overrides = [
        *run.overrides,
        'follower_can.bus.interface="stepped"',
        'leader_can.bus.interface="stepped"',
    ]
    config = load_config(run.config_path, overrides)
    clock = SteppedClock()
    with runtime_directory() as runtime, interruptible() as interrupted:
        record = DockingRecord(config, runtime)
        nodes = [
            entry.factory()(NodeContext(config, run.config_path, runtime, number, clock))
            for number, entry in enumerate(ONE_MACHINE, start=1)
        ]
        nodes.append(_StationNode(record, clock.now_ns() + NS_PER_S))
        end_ns = clock.now_ns() + round(RUN_TIMEOUT_S * NS_PER_S)
        with SteppedExecutor(nodes, clock) as executor:
            while record.phase not in ("done", "aborted") and clock.now_ns() < end_ns and not interrupted():
                executor.run(clock.now_ns() + NS_PER_S // 5)
                run.progress(record)
        record.release()
        if record.phase in ("done", "aborted"):
            return record, ""
        return record, "interrupted" if interrupted() else "time_limit"


# --- processes


def run_processes(run: Run) -> tuple[DockingRecord, str]:
    """One docking with every process of the table; the record and what ended it early, if anything."""
    with runtime_directory() as runtime, listening_socket() as server, interruptible() as interrupted:
        children: Children = {}
        try:
            start_children(
                children,
                run.config_path,
                _with_server(run.overrides, server),
                runtime,
                run.out / LOGS,
                server.fileno(),
            )
            with Bus(STATION, runtime, earlier_processes(STATION), run.config.network.namespace) as bus:
                wanted = {entry.name for entry in ONE_MACHINE}
                died = partial(death, children, run.out / LOGS)
                return _Session(run, runtime, bus, wanted, died, interrupted).dock()
        finally:
            stop_children(children)


def run_attached(run: Run, runtime: Path) -> tuple[DockingRecord, str]:
    """One docking with the processes of two robots and a world that somebody else started.

    Args:
        run: its configuration is that of the processes.
        runtime: the Follower's private directory; the Leader is reached through the gateways.

    Raises:
        ConfigError: no such directory.
    """
    if not runtime.is_dir():
        raise ConfigError(f"--attach {runtime}: no robot runs here")
    namespace = run.config.network.namespace
    with interruptible() as interrupted, Bus(STATION, runtime, earlier_processes(STATION), namespace) as bus:
        # the Leader may be out of reach for a while, in an approach: the Follower's processes and the world may not
        near = {entry.name for entry in PROCESSES if entry.robot != "leader"} - {*GATEWAYS.values()}
        died = Absence(bus, near, MonotonicClock())
        return _Session(run, runtime, bus, {entry.name for entry in PROCESSES}, died, interrupted).dock()


def _with_server(overrides: Sequence[str], server: socket.socket) -> list[str]:
    """The overrides that bring both buses to the CAN server on this socket."""
    host, port = server.getsockname()
    buses = [f'{bus}.bus.host="{host}"' for bus in ("follower_can", "leader_can")]
    buses += [f"{bus}.bus.port={port}" for bus in ("follower_can", "leader_can")]
    return [*overrides, *buses, f"world.can_server_fd={server.fileno()}"]


class _Session:
    """The station's side of one run: waits for the processes, asks for the docking, records, watches."""

    def __init__(
        self,
        run: Run,
        runtime: Path,
        bus: Bus,
        wanted: set[str],
        death: Callable[[], str],
        interrupted: Callable[[], bool],
    ) -> None:
        self._run, self._bus, self._interrupted = run, bus, interrupted
        self._wanted, self._death = wanted, death
        self._clock = MonotonicClock()
        self._record = DockingRecord(run.config, runtime)
        self._queue: queue.SimpleQueue[tuple[Channel[Any], bytes]] = queue.SimpleQueue()
        for channel in (*DockingRecord.CHANNELS, WORLD):
            bus.stream(channel, partial(self._enqueue, channel))

    def _enqueue(self, channel: Channel[Any], payload: bytes) -> None:
        self._queue.put((channel, payload))

    def dock(self) -> tuple[DockingRecord, str]:
        """Run to the end; the record and the cause if something other than the docking ended it."""
        cause = self._await_ready() or self._ask_start() or self._watch()
        self._record.release()
        return self._record, cause

    def _await_ready(self) -> str:
        deadline_ns = self._clock.now_ns() + round(READY_TIMEOUT_S * NS_PER_S)
        while True:
            missing = self._wanted - self._bus.alive()
            if not missing:
                return ""
            died = self._death()
            if died:
                return died
            if self._interrupted():
                return "interrupted"
            if self._clock.now_ns() > deadline_ns:
                return f"not ready in {READY_TIMEOUT_S:.0f} s: {', '.join(sorted(missing))}"
            self._drain(0.1)

    def _ask_start(self) -> str:
        """Ask the supervisor, again with the same id until it answers: it docks once."""
        request_id = f"sim-{secrets.token_hex(4)}"
        for number in range(1, 6):
            now_ns = self._clock.now_ns()
            request = DockRequest(request_id, now_ns + 5 * NS_PER_S, "start")
            header = Header(STATION, os.getpid(), number, now_ns, self._clock.boot_id)
            reply = self._bus.request(DOCK_REQUEST, encode(request, header), timeout_s=1.0)
            if reply is not None:
                _, answer = decode(Answer, reply)
                return "" if answer.outcome == "accepted" else f"start {answer.outcome}: {answer.reason}"
        return "the supervisor does not answer"

    def _watch(self) -> str:
        deadline_ns = self._clock.now_ns() + round(RUN_TIMEOUT_S * NS_PER_S)
        died, died_ns = "", 0
        while True:
            self._drain(0.05)
            now_ns = self._clock.now_ns()
            self._run.progress(self._record)
            if self._interrupted():
                return "interrupted"
            if not died:
                died, died_ns = self._death(), now_ns
                if not died and self._record.phase in ("done", "aborted"):
                    self._drain(0.3)
                    return ""
            elif now_ns - died_ns > _AFTER_DEATH_NS:
                return died
            if now_ns > deadline_ns:
                return died or "time_limit"

    def _drain(self, wait_s: float) -> None:
        """Record what came in ``wait_s`` seconds."""
        deadline = time.monotonic() + wait_s
        while (remaining := deadline - time.monotonic()) > 0:
            with contextlib.suppress(queue.Empty):
                channel, payload = self._queue.get(timeout=remaining)
                self._take(channel, payload)

    def _take(self, channel: Channel[Any], payload: bytes) -> None:
        try:
            header, message = decode(channel.message, payload)
        except MessageError as error:
            print(f"davpc: {channel.key}: {error}", file=sys.stderr)  # noqa: T201 - a fault nobody else reports
            return
        if channel is WORLD:
            self._record.take_truth(true_sample(message))
        else:
            self._record.take(channel, message, header.stamp_ns)
