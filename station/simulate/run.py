"""What to run and what came of it: the settings of a run, and the records of its dockings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from common.channels import Channel
from common.config import Config, load_config
from common.errors import ConfigError
from common.geometry import Pose2
from common.messages import Mission
from experiments.queues.collector import Collector
from sim.world_config import WorldConfig, world_config
from sim.world_message import WORLD, WorldState
from station.simulate import report
from station.simulate.record import DockingRecord, TrueSample
from station.simulate.report import Memory

STATION = "station"
LOGS = "logs"
RUN_TIMEOUT_S = 200.0
Progress = Callable[[DockingRecord], None]


@dataclass
class Run:
    """What to run: configuration file, overrides, where to put the logs, how many trolleys to dock.

    ``record``: leave ``run.mcap`` in ``out``; with ``frames`` every frame too, in ``run.frames.mcap``.
    """

    config_path: Path
    overrides: list[str]
    out: Path
    trolleys: int = 1
    progress: Progress = lambda _record: None
    record: bool = False
    frames: bool = False
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


class Recorder:
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
