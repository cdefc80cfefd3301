"""One job of a campaign: a method, a case, a start; and the table over many of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any

from common.config import Config
from common.geometry import Pose2
from experiments.feature_level.feature_world import Disturbances
from experiments.feature_level.pilots import PilotFactory
from experiments.feature_level.pixels.pilots import PixelPilotFactory
from experiments.feature_level.pixels.world import PixelWorld
from experiments.feature_level.scenes import Level, method_config, pixel_config
from experiments.feature_level.sets import Setting
from experiments.feature_level.trial import Outcome, fly, fly_in, goal_task, summarise
from experiments.shared.results import row

Flight = tuple["MethodCase", int]


@dataclass(frozen=True)
class MethodCase:
    """A method in one setting; the configuration as JSON, the key of the solvers that a process has built.

    ``label`` is the method's name in the results; ``array`` counts at feature level only, like ``held_frames``, for
    how many frames the noise stays the same. Each start has disturbances of its own. ``gains`` are a baseline's, None
    as tuned.
    """

    method: str
    label: str
    name: str
    config_text: str
    array: str
    starts: tuple[Pose2, ...]
    disturbances: tuple[Disturbances, ...]
    seed: int
    level: Level = "features"
    held_frames: int = 1
    gains: tuple[tuple[str, float], ...] | None = None


def make_case(
    config: Config, method: str, name: str, setting: Setting, seed: int,
    array: str = "vertical", label: str = "", level: Level = "features", gains: Mapping[str, float] | None = None,
) -> MethodCase:  # fmt: skip
    """A case; its runs are numbered by their starts.

    Args:
        config: the robots, before the method's own changes.
        method: one of ``METHODS``.
        name: of the case, in the results.
        setting: one run for each of its starts.
        seed: random seed.
        array: ``vertical`` or ``tilted``, at feature level.
        label: the method's name in the results; empty: as it is.
        level: features, or rendered pixels.
        gains: of a baseline, by name; None: as tuned.
    """
    text = config.model_dump_json()
    return MethodCase(
        method,
        label or method,
        name,
        text,
        array,
        tuple(setting.starts),
        tuple(setting.disturbances),
        seed,
        level,
        setting.held_frames,
        None if gains is None else tuple(gains.items()),
    )


def fly_job(job: Flight) -> Outcome:
    """Fly run ``i`` of a case; its noise depends on the seed and ``i`` alone, so methods meet the same noise."""
    case, i = job
    seed = [case.seed, i]
    if case.level == "pixels":
        pixels = _pixel_factory(case.config_text, case.method)
        world = PixelWorld(pixels.task.config, case.starts[i], seed, case.disturbances[i])
        return fly_in(world, pixels.task, pixels.make())
    factory = _factory(case.config_text, case.method, case.array, case.gains)
    return fly(factory.task, factory.make(), case.starts[i], seed, case.disturbances[i], held_frames=case.held_frames)


def metrics_job(job: Flight) -> dict[str, float]:
    """The metrics alone: little to send between processes."""
    return fly_job(job).metrics


def all_jobs(cases: list[MethodCase]) -> list[Flight]:
    """Every run of every case."""
    return [(case, i) for case in cases for i in range(len(case.starts))]


class Rows:
    """Rows of the results, each as soon as the runs of its case are complete; then what is there is written."""

    def __init__(self, cases: list[MethodCase], write: Callable[[list[dict[str, Any]]], object]) -> None:
        self._cases, self._write = cases, write
        self._metrics: dict[Flight, dict[str, float]] = {}
        self._rows: dict[MethodCase, dict[str, Any]] = {}

    def keep(self, job: Flight, metrics: dict[str, float]) -> None:
        """Take one run."""
        case, _ = job
        self._metrics[job] = metrics
        runs = [self._metrics.get((case, i)) for i in range(len(case.starts))]
        complete = [run for run in runs if run is not None]
        if len(complete) == len(runs):
            self._rows[case] = row(case.label, case.name, len(runs), summarise(complete))
            self._write(self.rows())

    def rows(self) -> list[dict[str, Any]]:
        """Those that are complete, in the order of the cases."""
        return [self._rows[case] for case in self._cases if case in self._rows]


@lru_cache(maxsize=8)  # a search makes many
def _factory(config_text: str, method: str, array: str, gains: tuple[tuple[str, float], ...] | None) -> PilotFactory:
    config = Config.model_validate_json(config_text)
    task = goal_task(method_config(config, method, array))
    return PilotFactory(method, task, None if gains is None else dict(gains))


@cache
def _pixel_factory(config_text: str, method: str) -> PixelPilotFactory:
    config = Config.model_validate_json(config_text)
    return PixelPilotFactory(method, goal_task(pixel_config(config, method)))
