"""One run of a method in a world of either level, and the paper's metrics of it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from pydantic import ValidationError

from common.config import Config
from common.docking_errors import paper_errors
from common.geometry import Array, Pose2, features_at
from common.timing import NS_PER_S
from experiments.feature_level.feature_world import Disturbances, FeatureWorld, FrameMeasurement
from experiments.feature_level.scenes import (
    DURATION_S,
    FRAME_RATE_HZ,
    FRAMES_PER_COMMAND,
    NOISE_PX,
    NOISE_THETA_RAD,
    OVER_BOUND_M,
)
from experiments.feature_level.task import Pilot, SolverEndedError, Task, Twist


class World(Protocol):
    """What a run needs of a world: at feature level, or at pixel level."""

    command: tuple[float, float]

    @property
    def follower_in_leader(self) -> Pose2:
        """{F} in {L}."""

    @property
    def wheels(self) -> tuple[float, float]:
        """Twist that the encoders measure."""

    def measure(self, time_ns: int) -> FrameMeasurement:
        """The frame taken now."""

    def advance(self, duration_s: float) -> None:
        """Drive on."""

    def true_pixels(self) -> Array:
        """Projections (n, 2) without noise."""

    def in_view(self) -> Array:
        """(n,) whether each projection lies in the image."""


MEANS = ("e_x_cm", "e_y_cm", "e_theta_deg", "e_p_px", "m_v", "m_w")
COUNTS = ("lost", "over_bound", "diverged", "time_limit")
METRICS = (*MEANS, *COUNTS, "settle_s")


@dataclass
class FlightTrace:
    """What a run looked like, one row for each control period."""

    time_s: list[float] = field(default_factory=list)
    pose: list[tuple[float, float, float]] = field(default_factory=list)
    command: list[tuple[float, float]] = field(default_factory=list)
    features: list[Array] = field(default_factory=list)
    disturbance: list[Array] = field(default_factory=list)
    compensation: list[tuple[float, float]] = field(default_factory=list)

    def arrays(self) -> dict[str, Array]:
        """The rows as arrays, by name."""
        return {name: np.array(rows) for name, rows in vars(self).items()}


@dataclass(frozen=True)
class Outcome:
    """Metrics of one run by name (``settle_s`` NaN: never), and its trace.

    A run that ``diverged`` (its method's numbers are none any more), or whose solver was ended at its ``time_limit``,
    ends there, and counts as lost.
    """

    metrics: dict[str, float]
    trace: FlightTrace


def fly(
    task: Task,
    pilot: Pilot,
    start: Pose2,
    seed: list[int],
    disturbances: Disturbances,
    duration_s: float = DURATION_S,
    held_frames: int = 1,
) -> Outcome:
    """Run at feature level for a while.

    Args:
        task: robots and goal.
        pilot: a method, fresh.
        start: pose of {F} in {L}.
        seed: of the noise.
        disturbances: of the world.
        duration_s: of the run.
        held_frames: for how many frames the noise stays the same.
    """
    world = FeatureWorld(task.config, start, seed, disturbances, NOISE_PX, NOISE_THETA_RAD, held_frames)
    return fly_in(world, task, pilot, duration_s)


def fly_in(world: World, task: Task, pilot: Pilot, duration_s: float = DURATION_S) -> Outcome:
    """Run for a while: a frame at 60 Hz, a command from every third.

    Args:
        task: robots and goal.
        world: at its start.
        pilot: a method, fresh.
        duration_s: of the run.
    """
    trace, applied, lost, ended = FlightTrace(), (0.0, 0.0), False, ""
    settled_since = math.nan
    for frame in range(round(duration_s * FRAME_RATE_HZ)):
        time_s = frame / FRAME_RATE_HZ
        due = frame % FRAMES_PER_COMMAND == 0
        applied, ended = _steered(world, pilot, round(time_s * NS_PER_S), applied, due)
        if ended:
            break
        if due:
            world.command = applied
            _note(trace, time_s, world, pilot, applied)
            near = _settled(task, world)
            settled_since = (time_s if math.isnan(settled_since) else settled_since) if near else math.nan
        world.advance(1.0 / FRAME_RATE_HZ)
        lost = lost or not bool(world.in_view().all())
    metrics = _metrics(task, world, trace, lost or bool(ended), math.nan if ended else settled_since)
    return Outcome(metrics | {name: float(ended == name) for name in ("diverged", "time_limit")}, trace)


def _steered(world: World, pilot: Pilot, now_ns: int, applied: Twist, due: bool) -> tuple[Twist, str]:
    """Command after a frame, and why the run ends here; empty if it does not."""
    try:
        pilot.see(world.measure(now_ns), world.wheels, applied)
        wanted = pilot.command(world.wheels, applied) if due else applied
    except (np.linalg.LinAlgError, FloatingPointError, ValidationError):
        return applied, "diverged"
    except SolverEndedError:
        return applied, "time_limit"
    return (wanted, "") if np.isfinite(wanted).all() else (applied, "diverged")


def _note(trace: FlightTrace, time_s: float, world: World, pilot: Pilot, applied: tuple[float, float]) -> None:
    trace.time_s.append(time_s)
    trace.pose.append(
        (world.follower_in_leader.x_m, world.follower_in_leader.y_m, world.follower_in_leader.theta_rad)
    )
    trace.command.append(applied)
    trace.features.append(world.true_pixels())
    trace.disturbance.append(pilot.insight.disturbance)
    trace.compensation.append(pilot.insight.compensation)


def _settled(task: Task, world: World) -> bool:
    """The supervisor's arrival test, on the truth."""
    docking = task.config.docking
    relative = world.follower_in_leader.inverse()
    if abs(relative.theta_rad - task.goal_leader_in_follower.theta_rad) > math.radians(docking.heading_tolerance_deg):
        return False
    try:
        error = features_at(task.points_l, relative, task.camera) - task.desired
    except ValueError:  # driven past the array
        return False
    return bool(np.abs(error).max() <= docking.feature_tolerance)


def _metrics(task: Task, world: World, trace: FlightTrace, lost: bool, settled_since: float) -> dict[str, float]:
    """At the end of the run: the paper's six columns and this project's."""
    errors = paper_errors(world.follower_in_leader, task.goal_leader_in_follower, task.config)
    change = np.diff(np.array([(0.0, 0.0), *trace.command]), axis=0)
    m_v, m_w = np.sqrt(np.mean(change**2, axis=0)) if len(change) else (math.nan, math.nan)
    return {
        **errors,
        "m_v": float(m_v),
        "m_w": float(m_w),
        "lost": float(lost),
        "over_bound": float(max(errors["e_x_cm"], errors["e_y_cm"]) > 100 * OVER_BOUND_M),
        "settle_s": settled_since,
    }


def summarise(outcomes: list[dict[str, float]]) -> dict[str, float | None]:
    """Means over runs, counts of what went wrong, worst e_y; ``settle_s`` None when no run settled."""
    table = {name: np.array([metrics[name] for metrics in outcomes]) for name in METRICS}
    summary = {name: _mean(table[name]) for name in MEANS}
    summary |= {name: float(table[name].sum()) for name in COUNTS}
    settled = table["settle_s"][np.isfinite(table["settle_s"])]
    summary["settle_s"] = _mean(settled)
    summary["unsettled"] = float(len(outcomes) - settled.size)
    summary["worst_e_y_cm"] = float(table["e_y_cm"].max())
    return summary


def _mean(values: Array) -> float | None:
    """Of those that are numbers: behind the array there is no e_p; None if none is."""
    numbers = values[np.isfinite(values)]
    return float(numbers.mean()) if numbers.size else None


def goal_task(config: Config) -> Task:
    """The paper's task: the first trolley."""
    return Task(config, config.docking.goal(1))
