"""``davpc experiment tune``: one search, one budget, one training set for every method.

The covariance matrix adaptation evolution strategy on the logarithms of the gains, from those in use. Each candidate
flies the same training runs; none of them is in a set that ``table1`` or ``disturbance`` reports.
"""

from __future__ import annotations

import importlib
import math
from pathlib import Path
from typing import Any

import numpy as np

from common.config import Config
from common.errors import ConfigError
from common.geometry import Array
from experiments.feature_level.runs import MethodCase, all_jobs, make_case, metrics_job
from experiments.feature_level.sets import Setting, disturbed_setting
from experiments.feature_level.trial import summarise
from experiments.shared.executor import Workers, run_all
from experiments.shared.results import row, write_results
from experiments.tuning.spaces import SPACES, Bounds, Gains, shipped, with_gains

POPULATION = 8
FIRST_SIGMA = 0.2  # of the range of each gain
TRAINED_ON = ("none", "yaw_pads", "none", "lateral_pads", "none", "slip_pads")
UNITS = {"e_x_cm": 1.431, "e_y_cm": 0.598, "e_theta_deg": 0.240}  # what the paper's method reaches in its Table I
SMOOTHNESS_UNITS = {"m_v": 0.010, "m_w": 0.057}
SMOOTHNESS_SHARE = 0.2
NOTE = (
    "`score`: mean over the runs of Σ log(1 + error / the paper's error), and a fifth of the same for M_v and M_ω; "
    "a lost run counts as a hundred times the paper's errors. `in_use`: the gains before the search."
)


def score(metrics: dict[str, float]) -> float:
    """How bad a run was. Logarithms, so that one lost run does not hide what the others say."""
    if metrics["lost"]:
        return len(UNITS) * math.log1p(100.0)
    errors = sum(math.log1p(metrics[name] / unit) for name, unit in UNITS.items())
    return errors + SMOOTHNESS_SHARE * sum(
        math.log1p(metrics[name] / unit) for name, unit in SMOOTHNESS_UNITS.items()
    )


class Scale:
    """Gains as points of the unit cube."""

    def __init__(self, space: dict[str, Bounds]) -> None:
        self._names = list(space)
        low, high = np.log(np.array(list(space.values()))).T
        self._low, self._span = low, high - low

    def point(self, gains: Gains) -> Array:
        """Of gains, those outside their bounds at the bound."""
        at = (np.log([gains[name] for name in self._names]) - self._low) / self._span
        clipped: Array = np.clip(at, 0.0, 1.0)
        return clipped

    def gains(self, point: Array) -> Gains:
        """At a point.

        Args:
            point: (m,) of the unit cube.
        """
        values = np.exp(self._low + self._span * point)
        return {name: float(value) for name, value in zip(self._names, values, strict=True)}


class Search:
    """One method's search; asked for candidates, given their scores."""

    def __init__(self, space: dict[str, Bounds], first: Gains, seed: int) -> None:
        try:
            cma = importlib.import_module("cmaes").CMA
        except ModuleNotFoundError as error:
            raise ConfigError(f"davpc experiment tune needs {error.name}: pip install 'davpc[tune]'") from error
        self._scale = Scale(space)
        start = self._scale.point(first)
        # CMA needs two dimensions: one gain alone gets a second that does nothing
        self._idle = 1 if len(start) == 1 else 0
        mean = np.append(start, [0.5] * self._idle)
        bounds = np.tile([0.0, 1.0], (len(mean), 1))
        self._cma = cma(mean=mean, sigma=FIRST_SIGMA, bounds=bounds, seed=seed, population_size=POPULATION)
        self._asked: list[Array] = []

    def candidates(self) -> list[Gains]:
        """Of the next generation."""
        self._asked = [self._cma.ask() for _ in range(POPULATION)]
        return [self._scale.gains(point[: len(point) - self._idle]) for point in self._asked]

    def learn(self, scores: list[float]) -> None:
        """The scores of these candidates, in their order."""
        self._cma.tell(list(zip(self._asked, scores, strict=True)))


def run(
    out: Path,
    seed: int,
    workers: Workers,
    config: Config,
    methods: tuple[str, ...] = tuple(SPACES),
    evaluations: int = 48,
    trials: int = 6,
) -> dict[str, Any]:
    """Search each method's gains; write ``results.json`` and ``table.md`` after each generation.

    Args:
        out: folder for the results.
        seed: of the training set and of the search.
        workers: who does the runs.
        config: the robots, with the gains to start from.
        methods: of ``SPACES``.
        evaluations: candidates of each method; rounded up to whole generations.
        trials: training runs of each candidate.
    """
    settings: dict[str, Any] = {
        "evaluations": evaluations,
        "trials": trials,
        "population": POPULATION,
        "trained_on": [TRAINED_ON[i % len(TRAINED_ON)] for i in range(trials)],
        "spaces": {method: {name: list(bounds) for name, bounds in SPACES[method].items()} for method in methods},
        "found": {},
    }
    rows: list[dict[str, Any]] = []
    training = training_setting(config, trials, seed)
    for method in methods:
        in_use = shipped(config, method)
        search = Search(SPACES[method], in_use, seed)
        (first,) = _flown(config, method, [in_use], training, seed, workers)
        best, best_row = in_use, first
        mine = [row(method, "in_use", trials, first)]
        for _ in range(math.ceil(evaluations / POPULATION)):
            candidates = search.candidates()
            results = _flown(config, method, candidates, training, seed, workers)
            search.learn([float(result["score"] or 0.0) for result in results])
            for gains, result in zip(candidates, results, strict=True):
                if (result["score"] or 0.0) < (best_row["score"] or 0.0):
                    best, best_row = gains, result
            settings["found"][method] = {"in_use": in_use, "tuned": best}
            mine = [mine[0], row(method, "tuned", trials, best_row)]
            results_now = write_results(out, "tune", seed, settings, [*rows, *mine], [], config, NOTE)
        rows += mine
    return results_now


def training_setting(config: Config, trials: int, seed: int) -> Setting:
    """Runs of the training set: every second one without a disturbance, the others with one that can be corrected."""
    kinds = [TRAINED_ON[i % len(TRAINED_ON)] for i in range(trials)]
    drawn = {kind: disturbed_setting(config, "training", kind, trials, seed) for kind in set(kinds)}
    starts = drawn[kinds[0]].starts
    return Setting(starts, [drawn[kind].disturbances[i] for i, kind in enumerate(kinds)], 1)


def _flown(
    config: Config, method: str, candidates: list[Gains], training: Setting, seed: int, workers: Workers
) -> list[dict[str, float | None]]:
    """Summary and score of each candidate on the training runs."""
    cases: list[MethodCase] = []
    for i, gains in enumerate(candidates):
        tuned, beside = with_gains(config, method, gains)
        cases.append(make_case(tuned, method, f"candidate_{i}", training, seed, gains=beside or None))
    metrics = run_all(metrics_job, all_jobs(cases), workers, method)
    trials = len(training.starts)
    found = []
    for i in range(len(cases)):
        mine = metrics[i * trials : (i + 1) * trials]
        found.append(summarise(mine) | {"score": float(np.mean([score(each) for each in mine]))})
    return found
