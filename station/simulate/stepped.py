"""Dockings in stepped time, all processes in this one: deterministic, faster than real time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from common.channels import DOCK_REQUEST, LOCK_REQUEST
from common.config import Config, load_config
from common.messages import DockRequest
from common.node import Inbox, Node, NodeContext, Output, Trigger
from common.processes import ONE_MACHINE
from common.recording.journal import JournalWriter
from common.timing import NS_PER_S, SteppedClock
from experiments.queues.collector import Collector
from sim.stepped import SteppedExecutor
from station.interrupts import interruptible
from station.simulate.children import runtime_directory
from station.simulate.recording import stepped_recording
from station.simulate.run import RUN_TIMEOUT_S, STATION, Collection, Recorder, Run


class StationNode(Node):
    """Asks for the dockings and records them, in stepped time."""

    name = STATION
    inputs = Recorder.CHANNELS
    outputs = (DOCK_REQUEST, LOCK_REQUEST)
    trigger = Trigger(period_ns=NS_PER_S // 10, wakes=Recorder.CHANNELS)

    def __init__(self, recorder: Recorder, collector: Collector) -> None:
        self._recorder, self._collector = recorder, collector

    def step(self, now_ns: int, inputs: Inbox) -> Sequence[Output]:
        for channel in Recorder.CHANNELS:
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
        # so far beyond every solve that ends by itself that a busy computer cannot change a result
        "controller.solve_limit_ms=60000",
    ]
    config = load_config(run.config_path, overrides)
    clock = SteppedClock()
    journals = {entry.name: JournalWriter() for entry in ONE_MACHINE if run.record and entry.journaled}
    with runtime_directory() as runtime, interruptible() as interrupted, stepped_recording(run, runtime) as tap:
        collector = Collector(run.first, run.trolleys, clock.now_ns() + NS_PER_S)
        recorder = Recorder(config, runtime, collector)
        nodes = [
            entry.factory()(_context(run, config, runtime, number, clock, journals.get(entry.name)))
            for number, entry in enumerate(ONE_MACHINE, start=1)
        ]
        nodes.append(StationNode(recorder, collector))
        end_ns = clock.now_ns() + round(run.trolleys * RUN_TIMEOUT_S * NS_PER_S)
        with SteppedExecutor(nodes, clock, tap, journals) as executor:
            while not collector.finished and clock.now_ns() < end_ns and not interrupted():
                executor.run(clock.now_ns() + NS_PER_S // 5)
                run.progress(recorder.current)
        recorder.current.release()
        if collector.finished:
            return Collection(recorder.records, collector.refused)
        return Collection(recorder.records, "interrupted" if interrupted() else "time_limit")


def _context(
    run: Run, config: Config, runtime: Path, number: int, clock: SteppedClock, journal: JournalWriter | None
) -> NodeContext:
    read_clock = clock if journal is None else journal.clock(clock)
    return NodeContext(config, run.config_path, runtime, number, read_clock, journal)
