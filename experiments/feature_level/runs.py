"""One job of a campaign: a method, a case, a start; and the table over many of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

from common.config import Config
from common.geometry import Pose2
from experiments.feature_level.feature_world import Disturbances
from experiments.feature_level.pilots import PilotFactory
from experiments.feature_level.pixels.pilots import PixelPilotFactory
from experiments.feature_level.pixels.world import PixelWorld
from experiments.feature_level.scenes import Level, method_config, pixel_config
from experiments.feature_level.trial import Outcome, fly, fly_in, goal_task, summarise
from experiments.shared.results import row

Flight = tuple["MethodCase", int]


@dataclass(frozen=True)
class MethodCase:
    """A method in one setting; the configuration as JSON, the key of the solvers that a process has built.

    ``label`` is the method's name in the results; ``array`` counts at feature level only.
    """

    method: str
    label: str
    name: str
    config_text: str
    array: str
    starts: tuple[Pose2, ...]
    disturbances: Disturbances
    seed: int
    level: Level = "features"


def make_case(
    config: Config, method: str, name: str, starts: list[Pose2], disturbances: Disturbances, seed: int,
    array: str = "vertical", label: str = "", level: Level = "features",
) -> MethodCase:  # fmt: skip
    """A case; its runs are numbered by their starts.

    Args:
        config: the robots, before the method's own changes.
        method: one of ``METHODS``.
        name: of the case, in the results.
        starts: poses of {F} in {L}, one run each.
        disturbances: of every run.
        seed: random seed.
        array: ``vertical`` or ``tilted``, at feature level.
        label: the method's name in the results; empty: as it is.
        level: features, or rendered pixels.
    """
    text = config.model_dump_json()
    return MethodCase(method, label or method, name, text, array, tuple(starts), disturbances, seed, level)


def fly_job(job: Flight) -> Outcome:
    """Fly run ``i`` of a case; its noise depends on the seed and ``i`` alone, so methods meet the same noise."""
    case, i = job
    seed = [case.seed, i]
    if case.level == "pixels":
        pixels = _pixel_factory(case.config_text, case.method)
        world = PixelWorld(pixels.task.config, case.starts[i], seed, case.disturbances)
        return fly_in(world, pixels.task, pixels.make())
    factory = _factory(case.config_text, case.method, case.array)
    return fly(factory.task, factory.make(), case.starts[i], seed, case.disturbances)


def metrics_job(job: Flight) -> dict[str, float]:
    """The metrics alone: little to send between processes."""
    return fly_job(job).metrics


def all_jobs(cases: list[MethodCase]) -> list[Flight]:
    """Every run of every case."""
    return [(case, i) for case in cases for i in range(len(case.starts))]


def table(cases: list[MethodCase], metrics: list[dict[str, float]]) -> list[dict[str, Any]]:
    """Rows of the results from the metrics of :func:`all_jobs`, in its order."""
    rows, at = [], 0
    for case in cases:
        count = len(case.starts)
        rows.append(row(case.label, case.name, count, summarise(metrics[at : at + count])))
        at += count
    return rows


@cache
def _factory(config_text: str, method: str, array: str) -> PilotFactory:
    config = Config.model_validate_json(config_text)
    return PilotFactory(method, goal_task(method_config(config, method, array)))


@cache
def _pixel_factory(config_text: str, method: str) -> PixelPilotFactory:
    config = Config.model_validate_json(config_text)
    return PixelPilotFactory(method, goal_task(pixel_config(config, method)))
