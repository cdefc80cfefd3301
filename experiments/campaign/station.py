"""The operator and the witness of a run: asks for dockings, lets faults happen, writes down what is true."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from common.channels import (
    COMMAND,
    DOCK_REQUEST,
    DOCKING_STATE,
    DRIVES,
    FOLLOWER_GATEWAY,
    LEADER_GATEWAY,
    LOCK_REQUEST,
    MISSION,
)
from common.geometry import wrap_angle
from common.messages import DockRequest
from common.node import Inbox, Node, Output, Trigger
from common.timing import NS_PER_S
from experiments.campaign.trace import CommandSample, DrivesSample, MissionSample, Trace
from experiments.queues.collector import Collector
from experiments.queues.run import QueuePlan

if TYPE_CHECKING:
    from experiments.campaign.stage import Stage

_PERIOD_NS = NS_PER_S // 100
_FALSE_RAD, _FALSE_M = math.radians(10.0), 0.3


class MemoryWriter:
    """Stands in for the thread that writes files: what is written is dropped at once; ``full``: the disk is."""

    def __init__(self) -> None:
        self.full = False
        self.fault = ""
        self.dropped = 0

    def append_line(self, path: Path, line: str) -> None:
        """As :meth:`BackgroundWriter.append_line`."""
        del line
        self._write(path)

    def replace(self, path: Path, content: str) -> None:
        """As :meth:`BackgroundWriter.replace`."""
        del content
        self._write(path)

    def close(self, timeout_s: float = 2.0) -> None:
        """Nothing waits."""

    def _write(self, path: Path) -> None:
        self.fault = f"{path}: No space left on device" if self.full else ""
        self.dropped += self.full


class Station(Node):
    """The operator and the witness: asks for dockings, and every 10 ms writes down what is true."""

    name = "station"
    inputs = (MISSION, COMMAND, DRIVES, DOCKING_STATE)
    outputs = (DOCK_REQUEST, LOCK_REQUEST, FOLLOWER_GATEWAY, LEADER_GATEWAY)
    trigger = Trigger(period_ns=_PERIOD_NS)

    def __init__(self, stage: Stage, plan: QueuePlan, start_ns: int) -> None:
        self._stage = stage
        self._collector = Collector(plan.first, plan.count, start_ns)
        self.collecting = True
        self.outgoing: list[Output] = []
        self.every: list[Callable[[], None]] = []
        self.later: list[tuple[int, Callable[[], None]]] = []
        self.phase, self.armed, self.ended_cause = "idle", False, ""

    def step(self, now_ns: int, inputs: Inbox) -> Sequence[Output]:
        """Watch, let scheduled faults happen, ask."""
        stage = self._stage
        mission = inputs.arrived(MISSION)
        if mission is not None:
            self.phase, self.armed = mission.phase, mission.armed
            self._collector.take(mission)
        if stage.trace is not None:
            self._witness(stage.trace, now_ns, inputs)
        due = [work for at_ns, work in self.later if at_ns <= now_ns]
        self.later = [entry for entry in self.later if entry[0] > now_ns]
        for work in (*due, *self.every):
            work()
        for answer in (*inputs.answers(DOCK_REQUEST), *inputs.answers(LOCK_REQUEST)):
            self._collector.answered(answer)
            if stage.trace is not None and answer.outcome == "refused":
                stage.trace.refused = answer.reason
        outputs, self.outgoing = self.outgoing, []
        request = self._collector.step(now_ns) if self.collecting else None
        if request is not None:
            outputs.append((DOCK_REQUEST if isinstance(request, DockRequest) else LOCK_REQUEST, request))
        return outputs

    def _witness(self, trace: Trace, now_ns: int, inputs: Inbox) -> None:
        stage = self._stage
        trace.world.append(stage.world_sample(now_ns))
        trace.bus.append(stage.bus_sample(now_ns))
        mission, drives = inputs.arrived(MISSION), inputs.arrived(DRIVES)
        command, state = inputs.arrived(COMMAND), inputs.arrived(DOCKING_STATE)
        if mission is not None:
            sample = MissionSample(now_ns, mission.phase, mission.armed, mission.cause, mission.waiting)
            if not trace.missions or trace.missions[-1][1:] != sample[1:]:
                trace.missions.append(sample)
        if drives is not None:
            said = DrivesSample(now_ns, drives.state, drives.cause)
            if not trace.drives or trace.drives[-1][1:] != said[1:]:
                trace.drives.append(said)
        if command is not None:
            trace.commands.append(CommandSample(command.stamp_ns, command.v_m_s, command.w_rad_s))
        if state is not None:
            pose = stage.plant.pose.inverse()
            off_m = math.hypot(state.x_m - pose.x_m, state.y_m - pose.y_m)
            turned = abs(wrap_angle(state.theta_rad - pose.theta_rad))
            trace.false_locks += state.valid and (turned > _FALSE_RAD or off_m > _FALSE_M)
            bound = stage.config.estimator.disturbance.bound
            shares = [abs(value) / most for value, most in zip(state.disturbance, bound, strict=True)]
            trace.disturbance = max(trace.disturbance, *shares)
