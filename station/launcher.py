"""Runs dockings of both robots, one or a queue, against the simulated backend: as processes, or stepped in this one.

The only place outside experiments and tests that knows the simulated backend by name.
"""

from __future__ import annotations

import contextlib
import os
import queue
import secrets
import signal
import socket
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from common.bus import Bus
from common.channels import DOCK_REQUEST, LOCK_REQUEST, Channel
from common.config import Config, ConfigError, load_config
from common.executor import EXIT_CONFIG, earlier_processes
from common.geometry import Pose2
from common.messages import Answer, DockRequest, Header, LockRequest, MessageError, Mission, decode, encode
from common.node import Inbox, Node, NodeContext, Output, Trigger
from common.processes import PROCESSES
from common.timing import NS_PER_MS, NS_PER_S, MonotonicClock, SteppedClock
from sim.collector import Collector
from sim.stepped import SteppedExecutor
from sim.world_config import WorldConfig, world_config
from sim.world_message import WORLD, WorldState
from station import report
from station.children import (
    Children,
    interruptible,
    listening_socket,
    resident_mb,
    runtime_directory,
    start_children,
    stop_children,
)
from station.record import DockingRecord, TrueSample
from station.report import Memory

STATION = "station"
LOGS = "logs"
READY_TIMEOUT_S = 40.0
RUN_TIMEOUT_S = 200.0
_MEMORY_EVERY_NS = 5 * NS_PER_S
_AFTER_DEATH_NS = 1_500 * NS_PER_MS
Progress = Callable[[DockingRecord], None]


@dataclass
class Run:
    """What to run: configuration file, overrides, where to put the logs, how many trolleys to dock."""

    config_path: Path
    overrides: list[str]
    out: Path
    trolleys: int = 1
    progress: Progress = lambda _record: None
    config: Config = field(init=False)
    world: WorldConfig = field(init=False)

    @property
    def first(self) -> int:
        """The first trolley to dock: those before it stand in the queue already."""
        return self.world.docked + 1

    def __post_init__(self) -> None:
        """Read and check everything, and make the folder empty of an earlier run's results.

        Raises:
            ConfigError: a mistake in the configuration, or ``out`` cannot be written to.
        """
        self.config = load_config(self.config_path, self.overrides)
        self.world = world_config(self.config, str(self.config_path))
        try:
            (self.out / LOGS).mkdir(parents=True, exist_ok=True)
            for pattern in report.OUTPUTS:
                for path in self.out.glob(pattern):
                    path.unlink()
            (self.out / report.RESULTS).touch()
            (self.out / report.RESULTS).unlink()
        except OSError as error:
            raise ConfigError(f"--out {self.out}: cannot be written to: {error.strerror}") from error


@dataclass
class Collection:
    """The records of one run, a docking each, and what ended it early, if anything did.

    ``memory_mb``: resident memory of each process by time [s]; empty where there are no processes.
    """

    records: list[DockingRecord]
    cause: str = ""
    memory_mb: Memory = field(default_factory=dict)


class _Recorder:
    """Takes every message into the record of the docking that is under way."""

    CHANNELS = (*DockingRecord.CHANNELS, WORLD)

    def __init__(self, config: Config, runtime: Path, collector: Collector) -> None:
        self._config, self._runtime, self._collector = config, runtime, collector
        self.records = [DockingRecord(config, runtime, collector.trolley)]

    @property
    def current(self) -> DockingRecord:
        """The record of the docking that is under way."""
        if self.records[-1].trolley != self._collector.trolley:
            self.records[-1].release()
            self.records.append(DockingRecord(self._config, self._runtime, self._collector.trolley))
        return self.records[-1]

    def take(self, channel: Channel[Any], message: Any, stamp_ns: int) -> None:
        """Take one message of :attr:`CHANNELS`."""
        if isinstance(message, WorldState):
            self.current.take_truth(true_sample(message))
            return
        self.current.take(channel, message, stamp_ns)
        if isinstance(message, Mission):
            self._collector.take(message)


def true_sample(world: WorldState) -> TrueSample:
    """The part of the world that a record keeps."""
    return TrueSample(world.time_ns, Pose2(world.x_m, world.y_m, world.theta_rad), world.v_m_s, world.w_rad_s)


# --- stepped


class _StationNode(Node):
    """Asks for the dockings and records them, in stepped time."""

    name = STATION
    inputs = _Recorder.CHANNELS
    outputs = (DOCK_REQUEST, LOCK_REQUEST)
    trigger = Trigger(period_ns=NS_PER_S // 10, wakes=_Recorder.CHANNELS)

    def __init__(self, recorder: _Recorder, collector: Collector) -> None:
        self._recorder, self._collector = recorder, collector

    def step(self, now_ns: int, inputs: Inbox) -> Sequence[Output]:
        for channel in _Recorder.CHANNELS:
            if inputs.arrived(channel) is not None:
                received = inputs.newest(channel)
                assert received is not None
                self._recorder.take(channel, received.message, received.header.stamp_ns)
        for answer in (*inputs.answers(DOCK_REQUEST), *inputs.answers(LOCK_REQUEST)):
            self._collector.answered(answer)
        request = self._collector.step(now_ns)
        if request is None:
            return ()
        return ((DOCK_REQUEST if isinstance(request, DockRequest) else LOCK_REQUEST, request),)


def run_stepped(run: Run) -> Collection:
    """Dockings in stepped time, in this process."""
    overrides = [
        *run.overrides,
        'follower_can.bus.interface="stepped"',
        'leader_can.bus.interface="stepped"',
    ]
    config = load_config(run.config_path, overrides)
    clock = SteppedClock()
    with runtime_directory() as runtime, interruptible() as interrupted:
        collector = Collector(run.first, run.trolleys, clock.now_ns() + NS_PER_S)
        recorder = _Recorder(config, runtime, collector)
        nodes = [
            entry.factory()(NodeContext(config, run.config_path, runtime, number, clock))
            for number, entry in enumerate(PROCESSES, start=1)
        ]
        nodes.append(_StationNode(recorder, collector))
        end_ns = clock.now_ns() + round(run.trolleys * RUN_TIMEOUT_S * NS_PER_S)
        with SteppedExecutor(nodes, clock) as executor:
            while not collector.finished and clock.now_ns() < end_ns and not interrupted():
                executor.run(clock.now_ns() + NS_PER_S // 5)
                run.progress(recorder.current)
        recorder.current.release()
        if collector.finished:
            return Collection(recorder.records, collector.refused)
        return Collection(recorder.records, "interrupted" if interrupted() else "time_limit")


# --- processes


def run_processes(run: Run) -> Collection:
    """Dockings with every process of the table."""
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
            with Bus(STATION, runtime, earlier_processes(STATION)) as bus:
                return _Session(run, runtime, bus, children, interrupted).collect()
        finally:
            stop_children(children)


def _with_server(overrides: Sequence[str], server: socket.socket) -> list[str]:
    """The overrides that bring both buses to the CAN server on this socket."""
    host, port = server.getsockname()
    buses = [f'{bus}.bus.host="{host}"' for bus in ("follower_can", "leader_can")]
    buses += [f"{bus}.bus.port={port}" for bus in ("follower_can", "leader_can")]
    return [*overrides, *buses, f"world.can_server_fd={server.fileno()}"]


class _Session:
    """The station's side of one run: waits for the processes, asks for the dockings, records, watches."""

    def __init__(
        self,
        run: Run,
        runtime: Path,
        bus: Bus,
        children: Children,
        interrupted: Callable[[], bool],
    ) -> None:
        self._run, self._bus, self._children, self._interrupted = run, bus, children, interrupted
        self._clock = MonotonicClock()
        self._collector = Collector(run.first, run.trolleys, 0, f"sim-{secrets.token_hex(4)}")
        self._recorder = _Recorder(run.config, runtime, self._collector)
        self._memory: Memory = {name: [] for name in children}
        self._memory_due_ns = self._began_ns = self._clock.now_ns()
        self._requests = 0
        self._queue: queue.SimpleQueue[tuple[Channel[Any], bytes]] = queue.SimpleQueue()
        for channel in _Recorder.CHANNELS:
            bus.stream(channel, partial(self._enqueue, channel))

    def _enqueue(self, channel: Channel[Any], payload: bytes) -> None:
        self._queue.put((channel, payload))

    def collect(self) -> Collection:
        """Run to the end."""
        cause = self._await_ready() or self._watch()
        self._recorder.current.release()
        return Collection(self._recorder.records, cause, self._memory)

    def _await_ready(self) -> str:
        deadline_ns = self._clock.now_ns() + round(READY_TIMEOUT_S * NS_PER_S)
        wanted = {process.name for process in PROCESSES}
        while True:
            missing = wanted - self._bus.alive()
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

    def _ask(self) -> None:
        """Hand on what the collector asks; it asks again with the same id until it has an answer."""
        now_ns = self._clock.now_ns()
        request = self._collector.step(now_ns)
        if request is None:
            return
        self._requests += 1
        header = Header(STATION, os.getpid(), self._requests, now_ns, self._clock.boot_id)
        channel: Channel[Any] = LOCK_REQUEST if isinstance(request, LockRequest) else DOCK_REQUEST
        reply = self._bus.request(channel, encode(request, header), timeout_s=1.0)
        if reply is not None:
            self._collector.answered(decode(Answer, reply)[1])

    def _watch(self) -> str:
        deadline_ns = self._clock.now_ns() + round(self._run.trolleys * RUN_TIMEOUT_S * NS_PER_S)
        died, died_ns = "", 0
        while True:
            self._drain(0.05)
            now_ns = self._clock.now_ns()
            self._run.progress(self._recorder.current)
            self._weigh(now_ns)
            if self._interrupted():
                return "interrupted"
            if died:
                if now_ns - died_ns > _AFTER_DEATH_NS:
                    return died
                continue
            died, died_ns = self._death(), now_ns
            if not died and self._collector.finished:
                self._drain(0.3)
                return self._collector.refused
            if not died:
                self._ask()
            if now_ns > deadline_ns:
                return "time_limit"

    def _weigh(self, now_ns: int) -> None:
        """Note how much memory each process holds."""
        if now_ns < self._memory_due_ns:
            return
        self._memory_due_ns = now_ns + _MEMORY_EVERY_NS
        for name, child in self._children.items():
            resident = resident_mb(child.pid)
            if resident is not None:
                self._memory.setdefault(name, []).append(((now_ns - self._began_ns) / NS_PER_S, resident))

    def _death(self) -> str:
        for name, child in self._children.items():
            code = child.poll()
            if code is None:
                continue
            last_words = self._last_words(name)
            if code == EXIT_CONFIG:
                raise ConfigError(last_words)
            how = signal.Signals(-code).name if code < 0 else f"exit code {code}: {last_words}"
            return f"process {name} died ({how})"
        return ""

    def _last_words(self, name: str) -> str:
        """What the process logged as its last error."""
        log = (self._run.out / LOGS / f"{name}.log").read_text(encoding="utf-8", errors="replace")
        errors = [line.partition(" ERROR ")[2] for line in log.splitlines() if " ERROR " in line]
        return errors[-1] if errors else f"see {LOGS}/{name}.log"

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
        self._recorder.take(channel, message, header.stamp_ns)
