"""Every process: one table against which command line, units and compose file are tested."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from collections.abc import Callable

    from common.node import Node, NodeContext

ENTRY_POINTS = "davpc.processes"


@dataclass(frozen=True)
class Process:
    """One process: its name, the robot it runs on, what makes it step and its purpose.

    ``priority`` is its SCHED_FIFO priority, where permitted: the shorter the loop, the higher. Only the controller,
    whose work is short and whose missed deadlines stop the robot, goes before camera and estimator. ``locked``: its
    memory is locked, where permitted. ``journaled``: its steps can be replayed, see :mod:`common.recording.journal`.
    """

    name: str
    robot: Literal["follower", "leader", "world"]
    rate_hz: float
    priority: int
    stepped_by: str
    purpose: str
    locked: bool = False
    journaled: bool = False

    def factory(self) -> Callable[[NodeContext], Node]:
        """The function that makes this process's node, found by entry point so that this table imports no robot."""
        (entry,) = entry_points(group=ENTRY_POINTS, name=self.name)
        make: Callable[[NodeContext], Node] = entry.load()
        return make


PROCESSES: tuple[Process, ...] = (
    Process("world", "world", 60, 50, "timer", "simulated backend: plant, CAN drives and I/O modules, light"),
    Process(
        "follower-can-bridge",
        "follower",
        100,
        60,
        "timer, command",
        "gate; CANopen to drives and inputs",
        locked=True,
        journaled=True,
    ),
    Process(
        "leader",
        "leader",
        50,
        40,
        "timer, requests",
        "LED array, guide and lock; CANopen to the I/O module",
        journaled=True,
    ),
    Process("follower-camera", "follower", 60, 30, "camera", "light → frame"),
    Process("follower-estimator", "follower", 60, 30, "frame", "frame → docking state", journaled=True),
    Process(
        "follower-controller",
        "follower",
        20,
        35,
        "every third docking state",
        "docking state → command",
        journaled=True,
    ),
    Process(
        "follower-arms",
        "follower",
        100,
        40,
        "drives",
        "handle torques, contact from joint torque",
        journaled=True,
    ),
    Process(
        "follower-supervisor",
        "follower",
        20,
        45,
        "timer, requests",
        "phases of a docking, arming",
        journaled=True,
    ),
    Process(
        "follower-recorder", "follower", 1, 1, "everything published", "a file of each docking, for replay and report"
    ),
    Process("follower-gateway", "follower", 2, 10, "timer", "the robot's only network socket: pair channels, mTLS"),
    Process("leader-gateway", "leader", 2, 10, "timer", "the robot's only network socket: pair channels, mTLS"),
)

GATEWAYS = {"follower": "follower-gateway", "leader": "leader-gateway"}
RECORDER = "follower-recorder"
# the processes when both robots share one machine and one mesh; there the station records
ONE_MACHINE: tuple[Process, ...] = tuple(
    entry for entry in PROCESSES if entry.name not in (*GATEWAYS.values(), RECORDER)
)


def process(name: str) -> Process:
    """The process of this name.

    Raises:
        KeyError: there is none; the text lists the known names.
    """
    for candidate in PROCESSES:
        if candidate.name == name:
            return candidate
    raise KeyError(f"no process {name!r}; there are: {', '.join(p.name for p in PROCESSES)}")
