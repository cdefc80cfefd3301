"""The experiment with disturbances."""

from __future__ import annotations

from pathlib import Path

from common.config import default_config_path, load_config
from experiments.feature_level import disturbance
from experiments.feature_level.sets import SetName
from experiments.shared.executor import ALONE

CONFIG = load_config(default_config_path())


def test_disturbance_draws_its_figure(tmp_path: Path) -> None:
    results = disturbance.run(tmp_path, 1, ALONE, CONFIG, trials=1, methods=("davpc",), cases=("yaw_pads",))
    assert (tmp_path / "disturbance.png").stat().st_size > 10_000
    assert [entry["case"] for entry in results["rows"]] == ["yaw_pads", "paper_pads"]
    assert results["rows"][0]["metrics"]["e_y_cm"] < 1.5


def test_sets_fly_other_disturbances_under_their_own_names(tmp_path: Path) -> None:
    sets: tuple[SetName, ...] = ("lab", "evaluation", "held_out")
    cases = ("yaw_pads", "yaw_bias_no_fade")
    results = disturbance.run(tmp_path, 1, ALONE, CONFIG, 1, ("davpc",), cases, sets=sets)
    names = [entry["case"] for entry in results["rows"]]
    assert names == ["yaw_pads", "yaw_bias_no_fade", "yaw_pads_evaluation", "yaw_pads_held_out", "paper_pads"]
    recorded = results["settings"]["disturbances"]
    assert recorded["yaw_pads"] != recorded["yaw_pads_evaluation"] != recorded["yaw_pads_held_out"]
    assert results["settings"]["noise_held_frames"]["yaw_pads_evaluation"] == 3
