"""One trial: the same for a seed, near the information limit, and its summary."""

from __future__ import annotations

import numpy as np

from common.config import default_config_path, load_config
from experiments.feature_level.cramer_rao import bound
from experiments.feature_level.pilots import PilotFactory
from experiments.feature_level.scenes import DISTURBANCES, DISTURBED_START, method_config, paper_start
from experiments.feature_level.trial import METRICS, fly, goal_task, summarise
from experiments.shared.results import markdown, row

CONFIG = load_config(default_config_path())


def test_a_run_is_the_same_to_the_bit() -> None:
    task = goal_task(method_config(CONFIG, "davpc"))
    factory, start = PilotFactory("davpc", task), paper_start(DISTURBED_START)
    first, second = (fly(task, factory.make(), start, [3, 0], DISTURBANCES["none"], 4.0) for _ in range(2))
    np.testing.assert_array_equal(first.trace.arrays()["command"], second.trace.arrays()["command"])
    np.testing.assert_array_equal(first.trace.arrays()["pose"], second.trace.arrays()["pose"])


def test_default_method_is_near_the_information_limit() -> None:
    task = goal_task(method_config(CONFIG, "davpc"))
    outcome = fly(
        task, PilotFactory("davpc", task).make(), paper_start(DISTURBED_START), [1, 0], DISTURBANCES["none"]
    )
    limit = bound(task, outcome.trace)
    assert outcome.metrics["lost"] == outcome.metrics["over_bound"] == 0.0
    assert 0.05 < limit["e_y_cm"] < 0.3
    assert outcome.metrics["e_y_cm"] < 4 * limit["e_y_cm"]


def test_summary_counts_and_averages() -> None:
    one = dict.fromkeys(METRICS, 1.0)
    never = one | {"settle_s": float("nan"), "e_y_cm": 3.0}
    summary = summarise([one, never])
    assert summary["e_y_cm"] == 2.0
    assert summary["worst_e_y_cm"] == 3.0
    assert summary["lost"] == 2.0
    assert summary["unsettled"] == 1.0
    assert summary["settle_s"] == 1.0
    assert markdown("x", [row("m", "c", 2, summary)]).count("\n") == 5
