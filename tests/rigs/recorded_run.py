"""A short docking in stepped time with its recording, made once for all tests of a process."""

from __future__ import annotations

import functools
import tempfile
from collections.abc import Callable
from pathlib import Path

from common.config import Config, load_config
from common.node import Node, NodeContext
from common.processes import ONE_MACHINE
from common.recording.files import RecordingFiles
from common.recording.journal import JournalWriter
from common.recording.run import FramePictures
from common.timing import NS_PER_S, SteppedClock
from experiments.queues.collector import Collector
from sim.node import WorldNode
from sim.stepped import SteppedExecutor
from sim.world_message import WORLD
from station.simulate.run import Recorder
from station.simulate.stepped import StationNode
from tests.rigs.canbus_rig import CONFIG_PATH

RUN_S = 6.0
START = "world.start=[2.0, 0.05, 1.0]"


def recording_config(*overrides: str) -> Config:
    """The reference robots on stepped buses, near the goal."""
    chosen = ['follower_can.bus.interface="stepped"', 'leader_can.bus.interface="stepped"', START]
    return load_config(CONFIG_PATH, [*chosen, *overrides])


class Rig:
    """What a fault is injected into."""

    def __init__(self, executor: SteppedExecutor, world: WorldNode) -> None:
        self.executor, self.plant, self.follower = executor, world.plant, world._follower


def record(
    path: Path,
    config: Config,
    seconds: float = RUN_S,
    *,
    lossless: bool = False,
    fault: Callable[[Rig], None] | None = None,
    fault_s: float = 0.0,
    views: bool = True,
) -> Path:
    """Record the first seconds of a docking.

    Args:
        path: of the recording.
        config: of the robots.
        seconds: how long at most; it ends half a second after the docking.
        lossless: keep every frame.
        fault: injected at ``fault_s``.
        fault_s: when [s].
        views: write what viewers show, pictures too.
    """
    clock = SteppedClock()
    journals = {entry.name: JournalWriter() for entry in ONE_MACHINE if entry.journaled}
    files = RecordingFiles(path, config, {"seed": "1"}, lossless=lossless, views=views, further=(WORLD,))
    with tempfile.TemporaryDirectory() as folder:
        runtime = Path(folder)
        pictures = FramePictures(runtime, float(views), 80, lossless=lossless)
        collector = Collector(1, 1, clock.now_ns() + NS_PER_S)
        nodes: list[Node] = []
        for number, entry in enumerate(ONE_MACHINE, start=1):
            journal = journals.get(entry.name)
            read_clock = clock if journal is None else journal.clock(clock)
            context = NodeContext(config, CONFIG_PATH, runtime, number, read_clock, journal)
            nodes.append(entry.factory()(context))
        recorder = Recorder(config, runtime, collector)
        nodes.append(StationNode(recorder, collector))
        with SteppedExecutor(
            nodes,
            clock,
            lambda channel, payload, time_ns: files.take(pictures.item(channel.key, payload, time_ns)),
            journals,
        ) as executor:
            if fault is not None:
                executor.run(round(fault_s * NS_PER_S))
                world = nodes[0]
                assert isinstance(world, WorldNode)
                fault(Rig(executor, world))
            executor.run(round(seconds * NS_PER_S), lambda: recorder.current.phase in ("aborted", "done"))
            executor.run(clock.now_ns() + NS_PER_S // 2)
    files.close()
    return path


@functools.cache
def recorded_run() -> Path:
    """The recording, with every frame of a small camera."""
    folder = Path(tempfile.mkdtemp(prefix="davpc-recorded-"))
    return record(folder / "run.mcap", recording_config(), lossless=True)
