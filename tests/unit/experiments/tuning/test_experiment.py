"""The search: gains back and forth, a score that no lost run hides, and that it finds what is better."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from common.config import default_config_path, load_config
from experiments.feature_level.trial import METRICS
from experiments.shared.executor import ALONE
from experiments.tuning import experiment
from experiments.tuning.experiment import Scale, Search, score
from experiments.tuning.spaces import SPACES, shipped, with_gains

CONFIG = load_config(default_config_path())


@pytest.mark.parametrize("method", sorted(SPACES))
def test_gains_in_use_lie_in_their_space_and_come_back(method: str) -> None:
    space, gains = SPACES[method], shipped(CONFIG, method)
    assert set(gains) == set(space)
    assert all(low <= gains[name] <= high for name, (low, high) in space.items())
    scale = Scale(space)
    assert scale.gains(scale.point(gains)) == pytest.approx(gains)
    other = {name: 0.5 * (low + high) for name, (low, high) in space.items()}
    config, beside = with_gains(CONFIG, method, other)
    assert (beside or shipped(config, method)) == pytest.approx(other)


def test_score_orders_runs() -> None:
    good = dict.fromkeys(METRICS, 0.0)
    worse, lost = good | {"e_y_cm": 0.598}, good | {"lost": 1.0}
    assert score(good) == 0.0
    assert score(worse) == pytest.approx(np.log(2.0))
    assert score(lost) > score(good | {"e_x_cm": 50.0, "e_y_cm": 20.0, "e_theta_deg": 10.0})


def test_search_finds_the_minimum_of_a_bowl() -> None:
    space = {"a": (0.01, 1.0), "b": (1.0, 100.0)}
    search = Search(space, {"a": 0.9, "b": 90.0}, seed=1)
    best = np.inf
    for _ in range(25):
        candidates = search.candidates()
        scores = [np.log(each["a"] / 0.1) ** 2 + np.log(each["b"] / 5.0) ** 2 for each in candidates]
        best = min(best, *scores)
        search.learn(scores)
    assert best < 1e-3


def test_a_small_search_writes_what_it_found(tmp_path: Path) -> None:
    results = experiment.run(tmp_path, 1, ALONE, CONFIG, ("ibvs",), evaluations=8, trials=2)
    rows = {entry["case"]: entry["metrics"]["score"] for entry in results["rows"]}
    assert rows["tuned"] <= rows["in_use"]
    found = results["settings"]["found"]["ibvs"]
    assert found["in_use"] == shipped(CONFIG, "ibvs")
    assert "| ibvs | tuned | 2 |" in (tmp_path / "table.md").read_text()


def test_training_runs_are_in_no_set_that_is_reported() -> None:
    training = experiment.training_setting(CONFIG, 6, 1)
    assert len(training.starts) == len(set(training.starts)) == 6
    assert [bool(each.pads) for each in training.disturbances] == [False, True] * 3
