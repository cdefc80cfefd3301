"""The table is whole, controls fit the code, branches do not touch their trunk, and jobs do not change results."""

from __future__ import annotations

import ast
import inspect
import json
from dataclasses import asdict
from pathlib import Path
from types import ModuleType

import pytest

from common.config import Config
from experiments.campaign.branch import BranchError, branch
from experiments.campaign.controls import CONTROLS, STAND_IN
from experiments.campaign.experiment import Job, control_tasks, run, seed_job, tasks_of
from experiments.campaign.faults import FAULTS
from experiments.campaign.judge import broken
from experiments.campaign.patches import found
from experiments.campaign.rows import ROWS
from experiments.campaign.trunk import PHASES
from experiments.shared.executor import ALONE, Workers
from follower.can_bridge import arm_gate, gate


def test_every_row_is_there_with_faults_and_phases_or_with_the_test_that_covers_it() -> None:
    assert list(ROWS) == [f"S{k:02}" for k in range(1, 50)]
    for row in ROWS.values():
        assert row.process or row.faults
        assert bool(row.faults) == bool(row.phases) == bool(row.reaction)
        assert set(row.faults) <= set(FAULTS)
        assert set(row.phases) <= set(PHASES)


def test_over_the_seeds_every_fault_comes_in_every_phase() -> None:
    done = {(task.row, task.phase, task.fault) for k in range(25) for task in tasks_of(k, tuple(ROWS))}
    assert done == {
        (row.id, phase, fault) for row in ROWS.values() for phase in row.phases for fault in row.usable(phase)
    }


@pytest.mark.parametrize("name", list(CONTROLS))
def test_what_a_control_removes_is_in_the_code(name: str) -> None:
    control = CONTROLS[name]
    assert set(control.rows) <= set(ROWS)
    assert any(task.control == name for task in control_tasks(tuple(ROWS)))
    for target, _ in control.patches:
        found(target)


# without an arm token or a command there is nothing to send; one rule of the arms goes by the name of another
_NOTHING_TO_SEND = {"not_armed", "no_command"}


@pytest.mark.parametrize("module", [gate, arm_gate])
def test_every_rule_of_the_gates_has_a_control(module: ModuleType) -> None:
    returned = (node.value for node in ast.walk(ast.parse(inspect.getsource(module))) if isinstance(node, ast.Return))
    texts = (part.value for value in returned if value is not None for part in ast.walk(value)
             if isinstance(part, ast.Constant))  # fmt: skip
    rules = {text for text in texts if isinstance(text, str) and text} - _NOTHING_TO_SEND
    assert len(rules) > 3
    prefix = "gate: " if module is gate else "arm gate: "
    names = {name.removeprefix(prefix) for name in CONTROLS if name.startswith(prefix)}
    spoken = {"arm_setpoint_age": "age", "arm_not_finite": "not finite", "arm_not_measured": "not measured"}
    assert {spoken.get(rule, rule.removeprefix("arm_")) for rule in rules} <= names


def test_only_known_controls_have_a_stand_in() -> None:
    assert set(STAND_IN) <= set(CONTROLS)


def test_a_branch_leaves_its_trunk_alone() -> None:
    kept = [1]
    assert branch(lambda: kept.append(2) or len(kept)) == 2  # type: ignore[func-returns-value]
    assert kept == [1]
    with pytest.raises(BranchError, match="ZeroDivisionError"):
        branch(lambda: 1 / 0)


def test_results_do_not_depend_on_the_jobs(config: Config, tmp_path: Path) -> None:
    rows = ("S31", "S28")
    one = run(tmp_path / "one", 1, ALONE, config, seeds=1, rows=rows, phases=("idle",))
    two = run(tmp_path / "two", 1, Workers(2), config, seeds=1, rows=rows, phases=("idle",))
    assert one["rows"] == two["rows"]
    (disk,) = [entry for entry in one["rows"] if entry["method"] == "S28"]
    assert disk["metrics"] == {"unsafe": 0, "wrong_reaction": 0, "wrong_cause": 0, "late": 0, "max_ms": None}
    assert (tmp_path / "one" / "matrix.png").stat().st_size > 10_000
    assert "| S28 |" in (tmp_path / "one" / "table.md").read_text()
    assert not (tmp_path / "one" / "unfinished").exists()


def test_a_run_that_was_interrupted_is_not_repeated(config: Config, tmp_path: Path) -> None:
    tasks = tasks_of(0, ("S28",))[:1]
    kept = tmp_path / "seed.jsonl"
    before = broken("S28", tasks[0].phase, tasks[0].fault, 1, "", "of an earlier call")
    kept.write_text(json.dumps(asdict(before)) + "\n")
    job = Job(config.model_dump_json(), 1, tasks, str(kept))
    assert seed_job(job) == [before]
    kept.write_bytes(3 * kept.read_bytes() + kept.read_bytes()[:50])
    assert seed_job(job) == [before]
