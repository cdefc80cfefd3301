"""The paper's first table: the agreed format, at any number of jobs, with the information limit."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from common.config import default_config_path, load_config
from experiments.feature_level import table1
from experiments.feature_level.runs import Flight
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


def test_rows_are_on_disk_as_soon_as_they_are_complete(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    flown = 0

    def stops_after_three(job: Flight) -> object:
        nonlocal flown
        flown += 1
        if flown == 4:
            raise KeyboardInterrupt
        return table1_job(job)

    table1_job = table1.measured_job
    monkeypatch.setattr(table1, "measured_job", stops_after_three)
    with pytest.raises(KeyboardInterrupt):
        table1.run(tmp_path, 2, ALONE, CONFIG, trials=2, methods=("ibvs", "pose_based"), cases=("T",))
    rows = json.loads((tmp_path / "results.json").read_text())["rows"]
    assert [(entry["method"], entry["n"]) for entry in rows] == [("ibvs", 2)]


def test_evaluation_set_has_cases_of_its_own(tmp_path: Path) -> None:
    results = table1.run(tmp_path, 2, ALONE, CONFIG, trials=1, methods=("ibvs",), cases=("E", "E_white"))
    errors = {entry["case"]: entry["metrics"]["e_y_cm"] for entry in results["rows"]}
    assert list(errors) == ["E", "E_white"]
    assert errors["E"] != errors["E_white"]
