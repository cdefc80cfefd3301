"""Short dockings, one of each kind of failure, and what has to come out of their recordings again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tests.rigs.recorded_run import Rig, record, recording_config

FOLDER = Path(__file__).parent
CORES = ("controller", "supervisor", "gate", "arms", "leader")
_QUICK = ("supervisor.lost_timeout_s=1.0", "supervisor.acquire_timeout_s=2.0")


@dataclass(frozen=True)
class Scenario:
    """One recording: configuration beside the reference, and a fault 3.5 s after the start."""

    overrides: tuple[str, ...] = ()
    fault: Callable[[Rig], None] | None = None
    seconds: float = 12.0

    def record(self, path: Path) -> Path:
        """Record it again."""
        config = recording_config(*_QUICK, *self.overrides)
        return record(path, config, self.seconds, fault=self.fault, fault_s=3.5, views=False)


def _silent_wheel(rig: Rig) -> None:
    rig.follower.bus.faults.silent.add(rig.follower.left_wheel.node_id)


SCENARIOS: dict[str, Scenario] = {
    "approach": Scenario(seconds=6.0),
    "glass_hall": Scenario(('world.scene="glass_hall"', "world.start=[3.0, 0.3, 3.0]"), seconds=6.0),
    "clutter40": Scenario(('world.scene="clutter40"', "world.start=[3.0, -0.2, 0.0]"), seconds=6.0),
    "camera_dead": Scenario(fault=lambda rig: rig.executor.halt("follower-camera")),
    "estop": Scenario(fault=lambda rig: rig.follower.set_stop_inputs(False, True)),
    "silent_wheel": Scenario(fault=_silent_wheel),
}


def stored(name: str) -> Path:
    """The reference recording of a scenario."""
    return FOLDER / f"{name}.mcap"
