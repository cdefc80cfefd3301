"""What the sequential experiment counts as docked and what it misses."""

from __future__ import annotations

import numpy as np
import pytest

from common.config import Config
from experiments.queues.run import Docking
from experiments.queues.sequential import bound_m, image_bound, metrics_of, missed, missed_means
from tests.rigs.queue_results import docked


def test_only_what_is_truly_locked_within_its_bound_counts(config: Config) -> None:
    false = docked(1, 0.5)
    false.locked = False
    metrics = metrics_of(config, [docked(1, 0.5), docked(1, 6.5), false, Docking(1, "aborted", "leds_lost")])
    assert metrics["docked"] == 1
    assert metrics["worst_e_y_cm"] == 6.5
    assert metrics["e_y_cm"] == pytest.approx(2.5)
    assert metrics_of(config, [docked(2, 6.5)])["docked"] == 1
    assert bound_m(config, 1) < bound_m(config, 2)


def test_the_image_allows_less_with_each_trolley(config: Config) -> None:
    bounds = np.array([image_bound(config, trolley) for trolley in range(1, 9)])
    assert (np.diff(bounds, axis=0) > 0.0).all()
    assert bounds[0, 0] < 0.5


def test_a_queue_misses_what_is_not_locked_not_within_its_bound_or_never_begun(config: Config) -> None:
    seen_wrong = docked(3, 0.5)
    seen_wrong.false_locks = 1
    queues = [
        [docked(1, 6.5), docked(2, 6.5), seen_wrong, docked(4, 1.0)],
        [docked(1, 0.1), Docking(2, "aborted", "slip")],
    ]
    assert missed(config, queues, 4) == [
        "trial 0, trolley 1: e_y 6.5 cm, more than 6 cm",
        "trial 0, trolley 3: false lock on the way",
        "trial 1, trolley 2: slip",
        "trial 1, trolley 3: not begun",
        "trial 1, trolley 4: not begun",
    ]


def test_a_mean_beyond_its_limit_is_missed_the_first_trolleys_sooner() -> None:
    queues = [[docked(1, 0.5), docked(2, 1.4)], [docked(1, 0.7), docked(2, 1.5)]]
    assert missed_means(queues) == ["trolley 1: mean e_y_cm 0.60, more than 0.5"]
    queues[1][1] = docked(2, 1.8)
    queues[0][0] = docked(1, 0.1)
    assert missed_means(queues) == ["trolley 2: mean e_y_cm 1.60, more than 1.5"]
    assert missed_means([[Docking(1, "aborted", "slip")]])[0].startswith("trolley 1: mean e_y_cm nan")
