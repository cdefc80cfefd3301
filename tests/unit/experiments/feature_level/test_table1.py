"""The paper's first table: the agreed format, at any number of jobs, with the information limit."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from common.config import default_config_path, load_config
from experiments.feature_level import table1
from experiments.feature_level.trial import METRICS
from experiments.shared.executor import ALONE, Workers

CONFIG = load_config(default_config_path())


def test_table1_writes_the_agreed_format_and_does_not_depend_on_jobs(tmp_path: Path) -> None:
    runs = [
        table1.run(tmp_path / str(jobs), 2, Workers(jobs), CONFIG, trials=2, methods=("ibvs",), cases=("T",))
        for jobs in (1, 2)
    ]
    written = json.loads((tmp_path / "1/results.json").read_text())
    assert runs[0] == runs[1] == written
    assert set(written) == {"experiment", "seed", "settings", "rows", "paper"}
    methods = [(entry["method"], entry["case"]) for entry in written["rows"]]
    assert methods == [("ibvs", "T")]
    assert set(METRICS) <= set(written["rows"][0]["metrics"])
    assert "| ibvs | T | 2 |" in (tmp_path / "1/table.md").read_text()
    assert written["paper"][2]["e_y_cm"] == 0.598


def test_table1_names_an_unknown_case(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="case 'X'"):
        table1.run(tmp_path, 1, ALONE, CONFIG, trials=1, methods=("ibvs",), cases=("X",))


def test_table1_tells_the_information_limit_along_the_default_method_alone(tmp_path: Path) -> None:
    results = table1.run(tmp_path, 2, ALONE, CONFIG, trials=1, methods=("davpc", "ibvs"), cases=("W",))
    rows = {entry["method"]: entry for entry in results["rows"]}
    assert list(rows) == ["davpc", "ibvs", "cramer_rao"]
    assert rows["cramer_rao"]["n"] == 1
    assert 0.05 < rows["cramer_rao"]["metrics"]["e_y_cm"] < 0.4
