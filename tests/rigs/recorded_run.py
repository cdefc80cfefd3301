"""A short docking in stepped time with its recording, made once for all tests of a process."""

from __future__ import annotations

import functools
import tempfile
from pathlib import Path

from common.config import Config, load_config
from common.node import NodeContext
from common.processes import ONE_MACHINE
from common.recording.files import RecordingFiles
from common.recording.journal import JournalWriter
from common.recording.run import FramePictures
from common.timing import NS_PER_S, SteppedClock
from experiments.queues.collector import Collector
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


def record(path: Path, config: Config, seconds: float = RUN_S, *, lossless: bool = False) -> Path:
    """Record the first seconds of a docking."""
    clock = SteppedClock()
    journals = {entry.name: JournalWriter() for entry in ONE_MACHINE if entry.journaled}
    files = RecordingFiles(path, config, {"seed": "1"}, lossless=lossless, further=(WORLD,))
    with tempfile.TemporaryDirectory() as folder:
        runtime = Path(folder)
        pictures = FramePictures(runtime, 1.0, 80, lossless=lossless)
        collector = Collector(1, 1, clock.now_ns() + NS_PER_S)
        nodes = []
        for number, entry in enumerate(ONE_MACHINE, start=1):
            journal = journals.get(entry.name)
            read_clock = clock if journal is None else journal.clock(clock)
            context = NodeContext(config, CONFIG_PATH, runtime, number, read_clock, journal)
            nodes.append(entry.factory()(context))
        nodes.append(StationNode(Recorder(config, runtime, collector), collector))
        with SteppedExecutor(
            nodes,
            clock,
            lambda channel, payload, time_ns: files.take(pictures.item(channel.key, payload, time_ns)),
            journals,
        ) as executor:
            executor.run(round(seconds * NS_PER_S))
    files.close()
    return path


@functools.cache
def recorded_run() -> Path:
    """The recording, with every frame of a small camera."""
    folder = Path(tempfile.mkdtemp(prefix="davpc-recorded-"))
    return record(folder / "run.mcap", recording_config(), lossless=True)
