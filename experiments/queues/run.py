"""Dockings in a row in stepped time, with all processes and every pixel: one job of an experiment.

The same nodes as on the robots run against the simulated world; the truth is that of the world, not of messages.
"""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2

from common.channels import COMMAND, DOCK_REQUEST, DOCKING_STATE, DRIVES, LOCK_REQUEST, MISSION
from common.config import Config, default_config_path
from common.docking_errors import paper_errors
from common.geometry import Pose2, wrap_angle
from common.messages import Command, DockRequest, Mission, Phase
from common.node import Inbox, Node, NodeContext, Output, Trigger
from common.processes import ONE_MACHINE
from common.timing import NS_PER_S, SteppedClock
from experiments.queues.collector import Collector
from follower.supervisor.journal import ATTEMPTS_FILE
from sim.node import WorldNode
from sim.stepped import SteppedExecutor
from sim.world_message import WORLD, WorldState

_TIME_LIMIT_S = 200.0
_AFTER_END_S = 0.5


@dataclass(frozen=True)
class QueuePlan:
    """One run: configuration (as JSON), changes to its ``[world]``, and which trolleys are docked.

    ``traced``: keep θ, commands and pose by time, for a figure.
    """

    config_text: str
    world: tuple[tuple[str, Any], ...] = ()
    first: int = 1
    count: int = 1
    traced: bool = False


@dataclass
class DockingTrace:
    """By time [s] since the start: true and estimated θ_L^F, θ of the homography, command, true pose in {L}."""

    time_s: list[float] = field(default_factory=list)
    theta_true: list[float] = field(default_factory=list)
    theta_estimated: list[float] = field(default_factory=list)
    theta_homography: list[float] = field(default_factory=list)
    v_m_s: list[float] = field(default_factory=list)
    w_rad_s: list[float] = field(default_factory=list)
    pose: list[tuple[float, float, float]] = field(default_factory=list)


@dataclass
class Docking:
    """Result of one docking.

    ``metrics`` are the true errors of the Follower at the end of the approach. ``locked`` is the truth of the world:
    the trolley stands home in guide or queue, and the bolt is behind the first. ``false_locks`` counts states of the
    approach marked valid with heading or bearing off by more than 10°. ``ever_armed``: the arm token was given.
    ``report`` is the attempt's record on disk; None: there is none.
    """

    trolley: int
    phase: Phase = "idle"
    cause: str = ""
    needs_reset: bool = False
    ever_armed: bool = False
    report: dict[str, Any] | None = None
    metrics: dict[str, float] = field(default_factory=dict)
    locked: bool = False
    false_locks: int = 0
    phases_s: list[tuple[Phase, float]] = field(default_factory=list)
    commands: list[tuple[int, float, float]] = field(default_factory=list)
    trace: DockingTrace | None = None

    @property
    def done(self) -> bool:
        """Docked, by the supervisor and in the world."""
        return self.phase == "done" and self.locked


class Backstage:
    """What an accident may change: the physical world and the executor."""

    def __init__(self, world: WorldNode, executor: SteppedExecutor) -> None:
        self.world, self.executor = world, executor


Accident = Callable[[int, Phase, Backstage], None]
"""Called with time, phase and backstage at every mission of the supervisor."""


class _Watcher(Node):
    """Requests the dockings, watches them, triggers accidents."""

    name = "station"
    inputs = (WORLD, MISSION, COMMAND, DOCKING_STATE, DRIVES)
    outputs = (DOCK_REQUEST, LOCK_REQUEST)
    trigger = Trigger(period_ns=NS_PER_S // 10, wakes=inputs)

    def __init__(self, config: Config, plan: QueuePlan, start_ns: int, accident: Accident | None) -> None:
        self._config, self._plan, self._accident = config, plan, accident
        self.collector = Collector(plan.first, plan.count, start_ns)
        self.backstage: Backstage | None = None
        self.dockings: list[Docking] = []
        self._truth: WorldState | None = None
        self._twist = (0.0, 0.0)

    def step(self, now_ns: int, inputs: Inbox) -> Sequence[Output]:
        world, mission = inputs.arrived(WORLD), inputs.arrived(MISSION)
        command, state = inputs.arrived(COMMAND), inputs.arrived(DOCKING_STATE)
        docking = self._docking()
        if world is not None:
            self._truth = world
        if command is not None:
            self._command(docking, command)
        if state is not None and self._truth is not None:
            self._compare(docking, state, now_ns)
        if mission is not None:
            self._mission(docking, mission, now_ns)
        for answer in (*inputs.answers(DOCK_REQUEST), *inputs.answers(LOCK_REQUEST)):
            self.collector.answered(answer)
        request = self.collector.step(now_ns)
        if request is None:
            return ()
        return ((DOCK_REQUEST if isinstance(request, DockRequest) else LOCK_REQUEST, request),)

    def _docking(self) -> Docking:
        if not self.dockings or self.dockings[-1].trolley != self.collector.trolley:
            self.dockings.append(Docking(self.collector.trolley, trace=DockingTrace() if self._plan.traced else None))
        return self.dockings[-1]

    def _command(self, docking: Docking, command: Command) -> None:
        self._twist = command.v_m_s, command.w_rad_s
        if docking.phase == "approach":
            docking.commands.append((command.frame_sequence, *self._twist))

    def _mission(self, docking: Docking, mission: Mission, now_ns: int) -> None:
        if mission.trolley == docking.trolley:
            if mission.phase != docking.phase:
                docking.phases_s.append((mission.phase, now_ns / NS_PER_S))
                if mission.phase == "insert" or (mission.phase in ("done", "aborted") and not docking.metrics):
                    docking.metrics = self._errors(docking.trolley)
            docking.phase, docking.cause, docking.needs_reset = mission.phase, mission.cause, mission.needs_reset
            docking.ever_armed |= mission.armed
        self.collector.take(mission)
        if self.backstage is None:
            return
        if docking.phase in ("done", "aborted"):
            plant = self.backstage.world.plant
            docking.locked = plant.leader.locked and plant.contact.home
        if self._accident is not None:
            self._accident(now_ns, docking.phase, self.backstage)

    def _errors(self, trolley: int) -> dict[str, float]:
        """The paper's E_p and E_s, true."""
        truth = self._truth
        if truth is None:
            return {}
        at = Pose2(truth.x_m, truth.y_m, truth.theta_rad)
        return paper_errors(at, self._config.docking.goal(trolley), self._config)

    def _compare(self, docking: Docking, state: Any, now_ns: int) -> None:
        """Estimate against truth; a valid pose that is far off is a false lock."""
        truth = self._truth
        assert truth is not None
        relative = Pose2(truth.x_m, truth.y_m, truth.theta_rad).inverse()
        turned = abs(wrap_angle(state.theta_rad - relative.theta_rad))
        bearing = abs(wrap_angle(math.atan2(state.y_m, state.x_m) - math.atan2(relative.y_m, relative.x_m)))
        if state.valid and docking.phase == "approach" and max(turned, bearing) > math.radians(10.0):
            docking.false_locks += 1
        trace = docking.trace
        if trace is None or docking.phase in ("idle", "done", "aborted"):
            return
        trace.time_s.append(now_ns / NS_PER_S)
        trace.theta_true.append(relative.theta_rad)
        trace.theta_estimated.append(state.theta_rad if state.valid else math.nan)
        measured = state.theta_homography_rad
        trace.theta_homography.append(math.nan if measured is None else measured)
        trace.v_m_s.append(self._twist[0])
        trace.w_rad_s.append(self._twist[1])
        trace.pose.append((truth.x_m, truth.y_m, truth.theta_rad))


def plan(config: Config, first: int = 1, count: int = 1, traced: bool = False, **world: Any) -> QueuePlan:
    """A plan of ``count`` dockings from trolley ``first`` on.

    Args:
        config: the robots.
        first: first trolley; those before it stand in the queue already.
        count: dockings in a row.
        traced: keep time series for a figure.
        world: changes to ``[world]``.
    """
    changes = {"docked": first - 1, **world}
    return QueuePlan(config.model_dump_json(), tuple(sorted(changes.items())), first, count, traced)


def planned_config(plan: QueuePlan) -> Config:
    """The configuration of a plan: both buses in this process."""
    config = Config.model_validate_json(plan.config_text)
    stepped = {"interface": "stepped"}
    update = {
        name: can.model_copy(update={"bus": can.bus.model_copy(update=stepped)})
        for name, can in (("follower_can", config.follower_can), ("leader_can", config.leader_can))
    }
    return config.model_copy(update={**update, "world": {**config.world, **dict(plan.world)}})


def _keep_reports(dockings: list[Docking], path: Path) -> None:
    """Give each docking the newest record of its trolley."""
    lines = path.read_text(encoding="utf-8").split("\n") if path.is_file() else []
    records = {record["trolley"]: record for record in map(json.loads, filter(None, lines))}
    for docking in dockings:
        docking.report = records.get(docking.trolley)


def run_plan(
    plan: QueuePlan, accident: Accident | None = None, cut_ns: int | None = None, linger_s: float = _AFTER_END_S
) -> list[Docking]:
    """Run a plan to its end.

    Args:
        plan: what to run.
        accident: called at every mission; None: nothing happens.
        cut_ns: time from which on nothing passes between the robots; None: never.
        linger_s: time to go on after the end, to see that it persists.
    """
    cv2.setNumThreads(1)
    config, clock = planned_config(plan), SteppedClock()
    path = default_config_path()
    with tempfile.TemporaryDirectory(prefix="davpc-") as folder:
        # the configured state directory belongs to the real robot: a simulation must not touch its queue and reports
        config = config.model_copy(update={"state_directory": folder})
        nodes: list[Node] = [
            entry.factory()(NodeContext(config, path, Path(folder), number, clock))
            for number, entry in enumerate(ONE_MACHINE, start=1)
        ]
        watcher = _Watcher(config, plan, clock.now_ns() + NS_PER_S, accident)
        executor = SteppedExecutor([*nodes, watcher], clock)
        if cut_ns is not None:
            executor.cut_link(cut_ns)
        world = next(node for node in nodes if isinstance(node, WorldNode))
        watcher.backstage = Backstage(world, executor)
        with executor:
            end_ns = clock.now_ns() + round(plan.count * _TIME_LIMIT_S * NS_PER_S)
            executor.run(end_ns, lambda: watcher.collector.finished)
            executor.run(clock.now_ns() + round(linger_s * NS_PER_S))
        _keep_reports(watcher.dockings, Path(folder) / ATTEMPTS_FILE)
    if watcher.collector.refused:
        watcher.dockings[-1].cause = watcher.collector.refused
    return watcher.dockings
