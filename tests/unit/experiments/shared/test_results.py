"""Results as they are written down."""

from __future__ import annotations

import json
from pathlib import Path

from common.config import default_config_path, load_config
from experiments.shared.results import row, write_results

CONFIG = load_config(default_config_path())


def test_a_metric_that_is_no_number_is_null_and_costs_no_other_result(tmp_path: Path) -> None:
    rows = [row("m", "c", 1, {"e_y_cm": float("nan"), "m_v": 0.1}), row("m", "d", 1, {"e_y_cm": float("inf")})]
    results = write_results(tmp_path, "x", 1, {"list": [(float("nan"), 1.0)]}, rows, [], CONFIG)
    text = (tmp_path / "results.json").read_text()
    assert json.loads(text) == results
    assert "NaN" not in text
    assert "Infinity" not in text
    assert results["rows"][0]["metrics"] == {"e_y_cm": None, "m_v": 0.1}
    assert results["rows"][1]["metrics"] == {"e_y_cm": None}
    assert results["settings"]["list"] == [[None, 1.0]]
    assert "| m | c | 1 | – | 0.100 |" in (tmp_path / "table.md").read_text()


def test_results_tell_the_configuration_with_its_overrides(tmp_path: Path) -> None:
    config = load_config(default_config_path(), ["controller.terminal_weight=7.5"])
    results = write_results(tmp_path, "x", 1, {}, [], [], config)
    kept = results["settings"]["configuration"]
    assert kept["controller"]["terminal_weight"] == 7.5
    assert kept == json.loads(config.model_dump_json())
