"""A short campaign: chosen failure modes of docs/safety.md, and a removed check that must turn it red."""

from __future__ import annotations

from pathlib import Path

import pytest

from common.config import Config
from experiments.campaign.experiment import run
from experiments.campaign.trunk import FaultTask, run_seed
from experiments.shared.executor import ALONE

SEED = 4
FREE = (
    "S01",
    "S03",
    "S05",
    "S06",
    "S08",
    "S13",
    "S14",
    "S21",
    "S22",
    "S27",
    "S29",
    "S33",
    "S39",
    "S40",
    "S42",
    "S49",
)
CONTACT = ("S01", "S04", "S08", "S14", "S20", "S24", "S33", "S34", "S35", "S38", "S39", "S49")


@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    ("rows", "phases"),
    [(FREE, ("approach",)), (FREE, ("last_metre",)), (CONTACT, ("push",))],
    ids=lambda names: names[-1],
)
def test_every_fault_is_answered_safely_rightly_by_name_and_in_time(
    config: Config, tmp_path: Path, rows: tuple[str, ...], phases: tuple[str, ...]
) -> None:
    results = run(tmp_path, SEED, ALONE, config, seeds=1, rows=rows, phases=phases)
    assert sum(entry["n"] for entry in results["rows"]) >= len(rows) - 1
    assert results["settings"]["missed"] == []


@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    ("row", "fault", "control"),
    [
        ("S01", "controller_dead", "gate: command_age and valid_until"),
        ("S08", "frozen", "estimator: frozen camera"),
        ("S33", "estop", "gate and supervisor: stop inputs"),
    ],
)
def test_without_a_check_its_row_turns_red(config: Config, row: str, fault: str, control: str) -> None:
    task = FaultTask(row=row, phase="approach", fault=fault)
    removed = FaultTask(row=row, phase="approach", fault=fault, control=control)
    kept, without = run_seed(config.model_dump_json(), SEED, (task, removed))
    assert kept.right, kept.text
    assert not without.right
    assert not any("the experiment failed" in why for why in without.unsafe)
