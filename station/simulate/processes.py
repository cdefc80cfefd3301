"""Dockings over Zenoh: with every process of the table and the simulated CAN server, or beside running robots."""

from __future__ import annotations

import secrets
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from common.channels import DOCK_REQUEST, LOCK_REQUEST, Channel
from common.errors import ConfigError
from common.messages import LockRequest, MessageError
from common.processes import GATEWAYS, ONE_MACHINE, PROCESSES, RECORDER
from common.timing import NS_PER_MS, NS_PER_S
from experiments.queues.collector import Collector
from station.interrupts import interruptible
from station.operate.link import RobotLink
from station.simulate.children import (
    Absence,
    Children,
    death,
    listening_socket,
    resident_mb,
    runtime_directory,
    start_children,
    stop_children,
    with_server,
)
from station.simulate.recording import live_recording
from station.simulate.report import Memory
from station.simulate.run import LOGS, RUN_TIMEOUT_S, STATION, Collection, Recorder, Run

READY_TIMEOUT_S = 40.0
_MEMORY_EVERY_NS = 5 * NS_PER_S
_AFTER_DEATH_NS = 1_500 * NS_PER_MS


def run_processes(run: Run) -> Collection:
    """Dockings with every process of the table."""
    with runtime_directory() as runtime, listening_socket() as server, interruptible() as interrupted:
        children: Children = {}
        try:
            start_children(
                children,
                run.config_path,
                with_server(run.overrides, server),
                runtime,
                run.out / LOGS,
                server.fileno(),
            )
            with (
                live_recording(run, runtime) as take,
                RobotLink(runtime, run.config.network.namespace, STATION) as link,
            ):
                if run.record:
                    link.overhear(take)
                wanted = {entry.name for entry in ONE_MACHINE}
                died = partial(death, children, run.out / LOGS)
                return _Session(run, runtime, link, wanted, died, interrupted, children).collect()
        finally:
            stop_children(children)


def run_attached(run: Run, runtime: Path) -> Collection:
    """Dockings with the processes of two robots and a world that another launcher started.

    Args:
        run: its configuration is that of the processes.
        runtime: the Follower's private directory; the Leader is reached through the gateways.

    Raises:
        ConfigError: no such directory.
    """
    if not runtime.is_dir():
        raise ConfigError(f"--attach {runtime}: no robot runs here")
    with (
        interruptible() as interrupted,
        live_recording(run, runtime) as take,
        RobotLink(runtime, run.config.network.namespace, STATION) as link,
    ):
        if run.record:
            link.overhear(take)
        # the Leader may be out of reach for a while, in an approach: the Follower's processes and the world may not
        near = {entry.name for entry in PROCESSES if entry.robot != "leader"} - {*GATEWAYS.values(), RECORDER}
        died = Absence(link.alive, near, link.clock)
        return _Session(
            run, runtime, link, {entry.name for entry in PROCESSES} - {RECORDER}, died, interrupted, {}
        ).collect()


class _Session:
    """The station's side of one run: waits for the processes, asks for the dockings, records, watches.

    Args:
        run: what to run.
        runtime: folder of the robots' frames.
        link: to the robots.
        wanted: the processes to wait for.
        death: names the process that ended, if one did.
        interrupted: whether the run is to end.
        children: those whose memory is measured.
    """

    def __init__(
        self,
        run: Run,
        runtime: Path,
        link: RobotLink,
        wanted: set[str],
        death: Callable[[], str],
        interrupted: Callable[[], bool],
        children: Children,
    ) -> None:
        self._run, self._link, self._children, self._interrupted = run, link, children, interrupted
        self._wanted, self._death = wanted, death
        self._collector = Collector(run.first, run.trolleys, 0, f"sim-{secrets.token_hex(4)}")
        self._recorder = Recorder(run.config, runtime, self._collector)
        self._memory: Memory = {name: [] for name in children}
        self._memory_due_ns = self._began_ns = link.now_ns
        self._stream = link.stream(*Recorder.CHANNELS)

    def collect(self) -> Collection:
        """Run to the end."""
        cause = self._await_ready() or self._watch()
        self._recorder.current.release()
        return Collection(self._recorder.records, cause, self._memory)

    def _await_ready(self) -> str:
        deadline_ns = self._link.now_ns + round(READY_TIMEOUT_S * NS_PER_S)
        while True:
            missing = self._wanted - self._link.alive()
            if not missing:
                return ""
            died = self._death()
            if died:
                return died
            if self._interrupted():
                return "interrupted"
            if self._link.now_ns > deadline_ns:
                return f"not ready in {READY_TIMEOUT_S:.0f} s: {', '.join(sorted(missing))}"
            self._drain(0.1)

    def _ask(self) -> None:
        """Pass on what the collector asks; it asks again with the same id until it has an answer."""
        request = self._collector.step(self._link.now_ns)
        if request is None:
            return
        channel: Channel[Any] = LOCK_REQUEST if isinstance(request, LockRequest) else DOCK_REQUEST
        answer = self._link.ask_once(channel, request)
        if answer is not None:
            self._collector.answered(answer)

    def _watch(self) -> str:
        deadline_ns = self._link.now_ns + round(self._run.trolleys * RUN_TIMEOUT_S * NS_PER_S)
        died, died_ns = "", 0
        while True:
            self._drain(0.05)
            now_ns = self._link.now_ns
            self._run.progress(self._recorder.current)
            self._measure_memory(now_ns)
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

    def _measure_memory(self, now_ns: int) -> None:
        """Note how much memory each process holds."""
        if now_ns < self._memory_due_ns:
            return
        self._memory_due_ns = now_ns + _MEMORY_EVERY_NS
        for name, child in self._children.items():
            resident = resident_mb(child.pid)
            if resident is not None:
                self._memory.setdefault(name, []).append(((now_ns - self._began_ns) / NS_PER_S, resident))

    def _drain(self, wait_s: float) -> None:
        """Record what came in ``wait_s`` seconds."""
        deadline = time.monotonic() + wait_s
        while (remaining := deadline - time.monotonic()) > 0:
            try:
                item = self._stream.next(remaining)
            except MessageError as error:
                print(f"davpc: {error}", file=sys.stderr)  # noqa: T201 - a fault that nothing else reports
                continue
            if item is not None:
                channel, header, message = item
                self._recorder.take(channel, message, header.stamp_ns)
