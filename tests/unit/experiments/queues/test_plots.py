"""The figures of the collection."""

from __future__ import annotations

from pathlib import Path

from common.config import Config
from experiments.queues.plots import draw_sequential
from experiments.queues.run import Docking
from experiments.queues.sequential import image_bound
from tests.rigs.queue_results import docked


def test_the_figure_is_drawn_with_failures_in_it(config: Config, tmp_path: Path) -> None:
    queues = [[docked(1, 0.3), docked(2, 0.6)], [docked(1, 0.2), Docking(2, "aborted", "leds_lost")]]
    draw_sequential(queues, [image_bound(config, trolley) for trolley in (1, 2)], config, tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 10_000
