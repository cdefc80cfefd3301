"""The experiment with disturbances."""

from __future__ import annotations

from pathlib import Path

from common.config import default_config_path, load_config
from experiments.feature_level import disturbance
from experiments.shared.executor import ALONE

CONFIG = load_config(default_config_path())


def test_disturbance_draws_its_figure(tmp_path: Path) -> None:
    results = disturbance.run(tmp_path, 1, ALONE, CONFIG, trials=1, methods=("davpc",), cases=("yaw_pads",))
    assert (tmp_path / "disturbance.png").stat().st_size > 10_000
    assert [entry["case"] for entry in results["rows"]] == ["yaw_pads", "paper_pads"]
    assert results["rows"][0]["metrics"]["e_y_cm"] < 1.5
