"""What the experiments of the collection count as right, and what they run with."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from common.causes import CAUSES
from common.config import Config
from experiments.incidents import CASES, End, is_right
from experiments.queue_plots import draw_sequential
from experiments.queue_run import Docking, plan, planned_config
from experiments.scenarios import SCENARIOS, Job, world_changes
from experiments.sequential import bound_m, image_bound, metrics_of
from sim.scenes import SCENES
from sim.world_config import world_config


def docked(trolley: int, e_y_cm: float) -> Docking:
    metrics = {"e_x_cm": 0.5, "e_y_cm": e_y_cm, "e_theta_deg": 0.2, "e_p_px": 1.0}
    return Docking(trolley, "done", "", metrics=metrics, locked=True)


def test_a_later_trolley_starts_with_the_others_in_the_queue(config: Config) -> None:
    planned = planned_config(plan(config, first=5, start=[8.0, 0.5, 0.0], scene="glass_hall", seed=9))
    world = world_config(planned, "plan")
    assert (world.docked, world.scene, world.seed) == (4, "glass_hall", 9)
    assert planned.follower_can.bus.interface == planned.leader_can.bus.interface == "stepped"
    assert config.world["seed"] != 9


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


def test_scenarios_are_those_of_the_paper_and_vary_with_the_trial(config: Config) -> None:
    assert [(s.name, s.trolley) for s in SCENARIOS.values()] == [
        ("dark_outdoor", 1),
        ("parking_lot", 2),
        ("glass_hall", 5),
    ]
    text = config.model_dump_json()
    for scenario in SCENARIOS.values():
        assert scenario.scene in SCENES
        starts = {tuple(world_changes(Job(text, scenario, 1, trial))["start"]) for trial in range(20)}
        assert len(starts) == 20
        for start in starts:
            planned = plan(config, first=scenario.trolley, scene=scenario.scene, start=list(start))
            world_config(planned_config(planned), scenario.name)


def test_every_expected_cause_is_one_that_exists() -> None:
    assert {end for case in CASES.values() for end in case.ends} - {"done"} <= set(CAUSES)


def test_an_incident_ends_rightly_only_at_standstill_with_its_cause_and_its_grip() -> None:
    case = CASES["Leader off in push"]
    good = End("leader_lost", still=True, held=True, latched_rightly=True, happened=True, phases=("push",))
    assert is_right(case, good)
    for wrong in ({"still": False}, {"held": False}, {"latched_rightly": False}, {"happened": False}):
        assert not is_right(case, End(**{**vars(good), **wrong}))
    assert not is_right(case, End(**{**vars(good), "ended": "done"}))


def test_the_figure_is_drawn_with_failures_in_it(config: Config, tmp_path: Path) -> None:
    queues = [[docked(1, 0.3), docked(2, 0.6)], [docked(1, 0.2), Docking(2, "aborted", "leds_lost")]]
    draw_sequential(queues, [image_bound(config, trolley) for trolley in (1, 2)], config, tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 10_000
