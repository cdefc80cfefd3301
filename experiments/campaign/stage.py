"""The whole cast of a docking in stepped time and private memory, with a hand on all that a fault may touch."""

from __future__ import annotations

import json
import logging
import math
import random
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from common.channels import Channel
from common.config import Config, default_config_path
from common.files.writer import BackgroundWriter
from common.geometry import Pose2
from common.messages import Message
from common.node import Inbox, Node, NodeContext, Outbox
from common.processes import ONE_MACHINE, process
from common.timing import NS_PER_S, SteppedClock
from experiments.campaign.station import MemoryWriter, Station
from experiments.campaign.trace import BusSample, MissionSample, Trace, WorldSample
from experiments.queues.run import QueuePlan, planned_config
from sim.can.drive_402 import Drive402
from sim.can.power_states import PowerState
from sim.stepped import SteppedExecutor


class Stage:
    """Nodes, clock, buses and plant of one run; ``trace`` is written while it is not None.

    Everything lives in this process's private memory, so that a fork makes an independent copy.
    """

    def __init__(self, plan: QueuePlan, seed: int, overrides: dict[str, Any] | None = None) -> None:
        cv2.setNumThreads(1)
        logging.disable(logging.CRITICAL)
        self.config: Config = planned_config(plan)
        if overrides:
            self.config = Config.model_validate_json(
                json.dumps(_merged(self.config.model_dump(mode="json"), overrides))
            )
        self.random = random.Random(seed)
        self.clock = SteppedClock()
        self.trace: Trace | None = None
        self._runs = 1000
        self._folder = tempfile.TemporaryDirectory(prefix="davpc-")
        self.config = self.config.model_copy(update={"state_directory": self._folder.name})
        nodes = [self._make(entry.name, number) for number, entry in enumerate(ONE_MACHINE, start=1)]
        self.station = Station(self, plan, self.clock.now_ns() + NS_PER_S)
        self.executor = SteppedExecutor([*nodes, self.station], self.clock)
        self.running: dict[str, Any] = {each.node.name: each for each in self.executor._running}
        self.plant: Any = self.node("world").plant
        self.follower: Any = self.node("world")._follower
        self.executor.__enter__()
        self._own_memory()
        self._tap()

    # -- what faults use

    def node(self, name: str) -> Any:
        """The node of a process."""
        return self.running[name].node

    def inbox(self, name: str) -> Inbox:
        """What a process receives."""
        box: Inbox = self.running[name].inbox
        return box

    def later(self, delay_s: float, work: Callable[[], None]) -> None:
        """``work`` happens once, that much later."""
        self.station.later.append((self.clock.now_ns() + round(delay_s * NS_PER_S), work))

    def every(self, work: Callable[[], None], for_s: float = math.inf) -> None:
        """``work`` happens every 10 ms from now on."""
        self.station.every.append(work)
        if math.isfinite(for_s):
            self.later(for_s, lambda: self.station.every.remove(work))

    def publish(self, channel: Channel[Any], message: Message) -> None:
        """The station sends it at its next step."""
        self.station.outgoing.append((channel, message))

    def restart(self, name: str) -> None:
        """A process begins a new run: nothing of the old one is left."""
        self._runs += 1
        running = self.running[name]
        if name == "follower-can-bridge":
            old = running.node._bus._bus
            if old is not None:
                old.close()
        running.node = self._make(name, self._runs)
        running.inbox = Inbox(self.clock.boot_id)
        running.outbox = Outbox(name, self._runs, self.clock.boot_id)
        running.desk = self.executor.desk(running.outbox)
        running.node.start(self.clock.now_ns())
        self._own_memory()
        self.executor.resume(name)

    # -- running

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False) -> bool:
        """Go on; whether ``until`` came true. A process that raises ends the run, named in the trace."""
        end_ns = self.clock.now_ns() + round(seconds * NS_PER_S)
        try:
            self.executor.run(end_ns, until)
        except Exception as error:
            if self.trace is None:
                raise
            self.trace.error = f"{type(error).__name__}: {error}"[:200]
        if until():
            return True
        if self.clock.now_ns() < end_ns and (self.trace is None or not self.trace.error):
            self.clock.advance_to(end_ns)
        return False

    def begin_trace(self) -> Trace:
        """Write down what happens from now on."""
        now_ns = self.clock.now_ns()
        self.trace = Trace(fault_ns=now_ns)
        self.trace.bus.append(self.bus_sample(now_ns))
        self.trace.missions.append(MissionSample(now_ns, self.station.phase, self.station.armed, "", ""))
        return self.trace

    def close(self) -> None:
        """End the run."""
        self.executor.__exit__()
        self._folder.cleanup()
        logging.disable(logging.NOTSET)

    def to_goal_m(self) -> float:
        """True distance that {F} has still to go along {L} to the goal of the first trolley."""
        return -float(self.plant.pose.x_m) - self.config.docking.goal(1).x_m

    def world_sample(self, now_ns: int) -> WorldSample:
        """The truth now."""
        plant = self.plant
        pose: Pose2 = plant.pose
        pushing = any(joint.effort == "torque" for joint in self.follower.joints)
        return WorldSample(
            now_ns, pose.x_m, pose.y_m, pose.theta_rad, plant.v_m_s, plant.w_rad_s,
            plant.arms.holding, plant.contact.handle_force_n, plant.leader.travel,
            plant.leader.locked and plant.contact.home, pushing,
        )  # fmt: skip

    def bus_sample(self, now_ns: int) -> BusSample:
        """What the drives follow now."""
        follower, base = self.follower, self.config.base
        left, right = (
            _setpoint(wheel) * base.wheel_radius_m for wheel in (follower.left_wheel, follower.right_wheel)
        )
        on = PowerState.OPERATION_ENABLED
        return BusSample(
            now_ns,
            (left + right) / 2,
            (right - left) / base.track_m,
            follower.left_wheel.state is on and follower.right_wheel.state is on,
            all(drive.state is on for drive in (*follower.joints, *follower.grippers)),
        )

    def _make(self, name: str, run_id: int) -> Node:
        folder = Path(self._folder.name)
        node = process(name).factory()(NodeContext(self.config, default_config_path(), folder, run_id, self.clock))
        _write_to_memory(node)
        return node

    def _own_memory(self) -> None:
        """Frames in memory that a fork copies, instead of a file that both sides would map."""
        ring, reader = self.node("follower-camera")._ring, self.node("follower-estimator")._reader
        if not isinstance(ring._memory, bytearray):
            ring._memory = bytearray(ring._memory[:])
        reader._open = lambda: ring._memory

    def _tap(self) -> None:
        """See what the bus carried after every SYNC."""
        bus = self.follower.bus
        handle = bus.handle

        def tapped(frame: Any, now_ns: int) -> Any:
            answers = handle(frame, now_ns)
            if self.trace is not None and frame.can_id == 0x80:
                self.trace.bus.append(self.bus_sample(now_ns))
            return answers

        bus.handle = tapped


def _setpoint(wheel: Drive402) -> float:
    """What a drive is commanded, rad/s at the wheel; 0 unless it follows."""
    if wheel.state is not PowerState.OPERATION_ENABLED:
        return 0.0
    return wheel.values[0x60FF, 0] / wheel._counts_per_unit


def _write_to_memory(holder: Any, depth: int = 2) -> None:
    """Replace the threads that write files."""
    for name, value in list(vars(holder).items()):
        if isinstance(value, BackgroundWriter):
            setattr(holder, name, MemoryWriter())
        elif depth and hasattr(value, "__dict__") and type(value).__module__.startswith(("follower", "leader")):
            _write_to_memory(value, depth - 1)


def _merged(table: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """A configuration with dotted keys changed."""
    for key, value in changes.items():
        *path, last = key.split(".")
        part = table
        for name in path:
            part = part[name]
        part[last] = value
    return table


def start_of(seed: int) -> tuple[list[float], int]:
    """A random start within the paper's range, and the world's seed."""
    draws = np.random.default_rng((seed, 13))
    spread = ((3.3, 0.15), (0.2, 0.15), (0.0, 4.0))
    return [float(at + draws.uniform(-off, off)) for at, off in spread], int(draws.integers(2**31))
