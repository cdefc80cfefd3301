"""Sets of runs: nothing shared between what is tuned on and what is reported, noise that is held, draws by seed."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from common.config import default_config_path, load_config
from experiments.feature_level.feature_world import Disturbances, FeatureWorld, inside_image, project
from experiments.feature_level.scenes import DISTURBANCES, PAPER_STARTS, paper_start
from experiments.feature_level.sets import EVALUATION, SetName, disturbed_setting, undisturbed_setting

CONFIG = load_config(default_config_path())


def test_evaluation_has_a_row_for_each_kind_and_none_of_the_labs() -> None:
    assert set(EVALUATION) == {name for name in DISTURBANCES if not name.endswith("no_fade")}
    for name, disturbances in EVALUATION.items():
        assert name == "none" or disturbances not in DISTURBANCES.values()
        assert bool(disturbances.pads) == bool(DISTURBANCES[name].pads)
        assert not set(disturbances.pads) & set(DISTURBANCES[name].pads)


@pytest.mark.parametrize("chosen", ["evaluation", "held_out", "training"])
def test_drawn_runs_repeat_for_a_seed_and_differ_between_sets_and_seeds(chosen: SetName) -> None:
    first, again, other = (disturbed_setting(CONFIG, chosen, "pads_load_lag", 8, seed) for seed in (5, 5, 6))
    assert first == again
    assert first.starts != other.starts
    assert all(inside_image(CONFIG, project(CONFIG, start)).all() for start in first.starts)
    for unlike in ("evaluation", "held_out", "training"):
        if unlike != chosen:
            assert not set(first.starts) & set(disturbed_setting(CONFIG, unlike, "none", 8, 5).starts)


def test_held_out_draws_every_run_again_and_only_what_its_kind_says() -> None:
    drawn = {name: disturbed_setting(CONFIG, "held_out", name, 20, 3).disturbances for name in EVALUATION}
    assert set(drawn["none"]) == {Disturbances()}
    for name, runs in drawn.items():
        if name != "none":
            assert len(set(runs)) == 20
    for run in drawn["yaw_pads"]:
        assert run.load_gain == 1.0
        assert all(pads.sideways_m_s == 0.0 and pads.speed_gain == 1.0 for pads in run.pads)
    assert all(0.8 <= run.load_gain <= 1.0 and run.pads == () for run in drawn["load"])
    combined = drawn["late_pads_load_lag_bias"]
    parts = {
        (pads.speed_gain < 1.0, pads.sideways_m_s != 0.0, pads.yaw_rad_s != 0.0)
        for run in combined
        for pads in run.pads
    }
    assert len(parts) >= 5


def test_noise_of_the_evaluation_set_is_held_for_three_frames() -> None:
    assert undisturbed_setting(CONFIG, "E", 2, 1).held_frames == 3
    white = undisturbed_setting(CONFIG, "E_white", 2, 1)
    assert white.held_frames == 1
    assert white.starts == undisturbed_setting(CONFIG, "E", 2, 1).starts
    world = FeatureWorld(CONFIG, paper_start(PAPER_STARTS[0]), 1, Disturbances(), 3.0, 0.05, held_frames=3)
    seen = [world.measure(0) for _ in range(7)]
    same = [
        np.array_equal(a.features, b.features) and a.theta_rad == b.theta_rad for a, b in itertools.pairwise(seen)
    ]
    assert same == [True, True, False, True, True, False]
