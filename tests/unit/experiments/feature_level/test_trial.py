"""One trial: the same for a seed, near the information limit, and its summary."""

from __future__ import annotations

import numpy as np
import pytest

from common.config import default_config_path, load_config
from common.geometry import Pose2
from experiments.feature_level.cramer_rao import bound
from experiments.feature_level.feature_world import FrameMeasurement
from experiments.feature_level.pilots import PilotFactory
from experiments.feature_level.scenes import DISTURBANCES, DISTURBED_START, method_config, paper_start
from experiments.feature_level.task import Insight, SolverEndedError, Twist
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


class _Pilot:
    """Drives straight on, until something happens."""

    def __init__(self, happens: Exception | tuple[float, float]) -> None:
        self.insight, self._happens, self._commands = Insight(), happens, 0

    def see(self, measurement: FrameMeasurement, wheels: Twist, applied: Twist) -> None:
        pass

    def command(self, wheels: Twist, applied: Twist) -> Twist:  # noqa: ARG002
        self._commands += 1
        if self._commands < 10:
            return 0.1, 0.0
        if isinstance(self._happens, Exception):
            raise self._happens
        return self._happens


@pytest.mark.parametrize(
    ("happens", "name"),
    [
        (np.linalg.LinAlgError("SVD did not converge"), "diverged"),
        ((np.nan, 0.0), "diverged"),
        ((0.0, np.inf), "diverged"),
        (SolverEndedError(), "time_limit"),
    ],
)
def test_a_run_that_cannot_go_on_is_lost_by_name(happens: Exception | tuple[float, float], name: str) -> None:
    task = goal_task(method_config(CONFIG, "davpc"))
    outcome = fly(task, _Pilot(happens), paper_start(DISTURBED_START), [1, 0], DISTURBANCES["none"])
    assert len(outcome.trace.command) == 9
    assert outcome.metrics["lost"] == outcome.metrics[name] == 1.0
    summary = summarise([outcome.metrics])
    assert summary[name] == summary["lost"] == summary["unsettled"] == 1.0


def test_numbers_that_diverge_in_an_observer_or_a_start_are_no_traceback() -> None:
    """The paper's method without a sight of the array: its carried features leave the image and every range."""
    task = goal_task(method_config(CONFIG, "paper"))
    pilot = PilotFactory("paper", task).make()
    behind = Pose2(-2.0, 0.0, 0.3)
    unseen = np.full((4, 2), np.nan)
    pilot.see(FrameMeasurement(0, task.seen_from(behind.inverse()), 0.3), (0.0, 0.0), (0.0, 0.0))
    for frame in range(1, 1200):
        pilot.see(FrameMeasurement(frame, unseen, np.nan), (0.5, 0.6), (0.5, 0.6))
        if frame % 300 == 0:
            assert np.isfinite(pilot.command((0.5, 0.6), (0.5, 0.6))).all()


def test_behind_the_array_there_is_no_e_p() -> None:
    one = dict.fromkeys(METRICS, 1.0)
    assert summarise([one, one | {"e_p_px": float("nan")}])["e_p_px"] == 1.0
    assert summarise([one | {"e_p_px": float("nan")}])["e_p_px"] is None
