"""One seed: a docking without a fault, from which every fault branches off in the phase in which it happens."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from random import Random

from common.channels import DOCK_REQUEST
from common.config import Config
from common.messages import DockRequest
from common.timing import NS_PER_S
from experiments.campaign.branch import BranchError, branch
from experiments.campaign.controls import CONTROLS
from experiments.campaign.faults import FAULTS, OVERRIDES, hide_leds
from experiments.campaign.judge import Verdict, broken, judge
from experiments.campaign.rows import ROWS, Row
from experiments.campaign.stage import Stage, start_of
from experiments.campaign.trace import BusSample, Trace
from experiments.queues.run import QueuePlan, plan

REFERENCE_S = 2.1
_TO_THE_END_S = 90.0
_LEAST_NS = NS_PER_S
_STOOD_SAMPLES, _STILL = 50, 0.005


@dataclass(frozen=True, kw_only=True)
class FaultTask:
    """One branch: which row's which fault, in which phase, and whether it is followed to the docking's end.

    ``control`` names a check that is removed first, or is empty.
    """

    row: str
    phase: str
    fault: str
    to_end: bool = False
    control: str = ""


@dataclass(frozen=True, kw_only=True)
class Point:
    """A moment of the undisturbed docking: when it is reached, and the most that it may take to get there."""

    phase: str
    reached: Callable[[Stage], bool]
    within_s: float = 40.0


POINTS = (
    Point(phase="idle", reached=lambda stage: stage.clock.now_ns() >= 1_700_000_000),
    Point(phase="acquire", reached=lambda stage: stage.station.phase == "acquire"),
    Point(phase="approach", reached=lambda stage: stage.station.phase == "approach" and stage.plant.v_m_s > 0.2),
    Point(phase="last_metre", reached=lambda stage: stage.station.phase == "approach" and stage.to_goal_m() < 0.6),
    Point(phase="insert", reached=lambda stage: stage.station.phase == "insert" and stage.plant.v_m_s > 0.03),
    Point(phase="push", reached=lambda stage: stage.station.phase == "push"),
    Point(phase="lock", reached=lambda stage: stage.station.phase == "lock"),
    Point(phase="release", reached=lambda stage: stage.station.phase == "release"),
    Point(phase="retract", reached=lambda stage: stage.station.phase == "retract" and stage.plant.v_m_s < -0.05),
    Point(phase="staging", reached=lambda stage: stage.station.phase == "staging" and stage.plant.v_m_s < -0.05),
)
SEARCH = Point(phase="search", reached=lambda s: s.station.phase == "search" and abs(s.plant.w_rad_s) > 0.1)
PHASES = (*(point.phase for point in POINTS[:3]), SEARCH.phase, *(point.phase for point in POINTS[3:]))


def run_seed(config_text: str, seed: int, tasks: tuple[FaultTask, ...]) -> Iterator[Verdict]:
    """Every task of one seed, each as it is done, in the order in which the docking comes to their phases."""
    config = Config.model_validate_json(config_text)
    start, world_seed = start_of(seed)
    what = plan(config, count=2, start=start, seed=world_seed)
    stage = Stage(what, seed)
    gc.freeze()
    try:
        for point in POINTS:
            if not any(_index(task.phase) >= _index(point.phase) for task in tasks):
                break
            _reach(stage, point, seed)
            yield from _branches(stage, what, seed, point.phase, tasks)
            if point.phase == "approach" and any(task.phase == SEARCH.phase for task in tasks):
                yield from branch(lambda: _search(stage, what, seed, tasks))
    finally:
        stage.close()


def _index(phase: str) -> int:
    return PHASES.index(phase)


def _reach(stage: Stage, point: Point, seed: int) -> None:
    if not stage.run(point.within_s, lambda: point.reached(stage)):
        raise RuntimeError(
            f"seed {seed}: the undisturbed docking did not come to {point.phase} in {point.within_s} s"
        )


def _search(stage: Stage, what: QueuePlan, seed: int, tasks: tuple[FaultTask, ...]) -> list[Verdict]:
    """In a branch of its own: the LEDs are hidden until the robot turns to find them."""
    hide_leds(stage, 9.0)
    _reach(stage, SEARCH, seed)
    return list(_branches(stage, what, seed, SEARCH.phase, tasks))


def _branches(
    stage: Stage, what: QueuePlan, seed: int, phase: str, tasks: tuple[FaultTask, ...]
) -> Iterator[Verdict]:
    tasks = tuple(task for task in tasks if task.phase == phase)
    if not tasks:
        return
    delay_s = Random(f"{seed} {phase}").uniform(0.0, 0.05)
    reference = branch(lambda: _reference(stage, delay_s))
    for task in tasks:
        try:
            yield branch(lambda: _run(stage, what, seed, task, delay_s, reference))  # noqa: B023 - called at once
        except BranchError as error:
            yield broken(task.row, task.phase, task.fault, seed, task.control, str(error))


def _reference(stage: Stage, delay_s: float) -> list[BusSample]:
    """What the bus carries without a fault."""
    stage.run(delay_s)
    trace = stage.begin_trace()
    stage.run(REFERENCE_S)
    return trace.bus


def _run(
    stage: Stage, what: QueuePlan, seed: int, task: FaultTask, delay_s: float, reference: list[BusSample]
) -> Verdict:
    """One fault, to its judgement."""
    if task.fault in OVERRIDES:
        # the channels of the stage that this one replaces are freed; its folder stays the trunk's
        stage.executor.__exit__()
        with closing(Stage(what, seed, OVERRIDES[task.fault])) as own:
            return _staged(own, seed, task, delay_s, reference)
    return _staged(stage, seed, task, delay_s, reference)


def _staged(stage: Stage, seed: int, task: FaultTask, delay_s: float, reference: list[BusSample]) -> Verdict:
    row = ROWS[task.row]
    if task.control:
        CONTROLS[task.control].remove()
    gc.disable()  # a branch is over before its garbage matters
    stage.run(delay_s)
    trace = stage.begin_trace()
    FAULTS[task.fault](stage)
    if not trace.outcome:
        _observe(stage, trace, row, task)
    return judge(row, task.phase, task.fault, seed, trace, reference, stage.config, task.to_end, task.control)


def _observe(stage: Stage, trace: Trace, row: Row, task: FaultTask) -> None:
    """Go on as long as the row asks for, or to the end of the docking; then ask for another one."""
    watched_s = row.idle_s if task.phase == "idle" else row.observe_s
    brief = not (row.stays or task.to_end or task.phase == "idle")
    stage.run(watched_s, lambda: brief and _stopped(stage, trace))
    if task.to_end and not trace.error:
        stage.run(_TO_THE_END_S, lambda: stage.station.phase in ("done", "aborted"))
        stage.run(0.3)
    stage.station.collecting = False
    trace.close()
    if trace.end and trace.end != "done" and not trace.error:
        again = DockRequest("again", stage.clock.now_ns() + 5 * NS_PER_S, "start", 1)
        stage.publish(DOCK_REQUEST, again)
        stage.run(0.15)


def _stopped(stage: Stage, trace: Trace) -> bool:
    """Whether it was disarmed and has stood for long enough to tell that it stays so."""
    newest = trace.bus[-1]
    if newest.arms_on or newest.commanded or trace.fault_ns + _LEAST_NS > stage.clock.now_ns():
        return False
    recent = trace.world[-_STOOD_SAMPLES:]
    still = all(abs(s.v_m_s) < _STILL and abs(s.w_rad_s) < _STILL for s in recent)
    return len(recent) == _STOOD_SAMPLES and still and not any(s.arms_on for s in trace.bus[-2 * _STOOD_SAMPLES :])
