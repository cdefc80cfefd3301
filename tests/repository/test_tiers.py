"""The two tiers: what only a calm host can judge has a stepped twin in the first; each closes with a table."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
# what skips a test for the host's sake: the judge, the watch that it uses, a docking of another machine
JUDGES = {"judged_on_a_calm_host", "HostWatch", "dock"}
MARKS = {"judged_on_a_calm_host", "stepped_twin"}


def run_pytest(*arguments: str | Path, cwd: Path) -> list[str]:
    """Lines that pytest prints in a process of its own."""
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *arguments]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True).stdout.splitlines()


def called(node: ast.expr) -> str:
    """The last word of what a call calls."""
    return ast.unparse(node.func).split(".")[-1] if isinstance(node, ast.Call) else ""


def judged() -> Iterator[tuple[str, list[ast.Call]]]:
    """Tests that may be skipped for the host's sake, each with its marks that name a twin."""
    for folder in ("system", "net", "docker", "deploy"):
        for path in sorted((ROOT / "tests" / folder).glob("test_*.py")):
            for node in ast.parse(path.read_text()).body:
                if not isinstance(node, ast.FunctionDef) or not node.name.startswith("test_"):
                    continue
                if JUDGES & {called(part) for part in ast.walk(node) if isinstance(part, ast.Call)}:
                    marks = [mark for mark in node.decorator_list if isinstance(mark, ast.Call)]
                    yield f"{path.name}::{node.name}", [mark for mark in marks if called(mark) in MARKS]


def test_what_only_a_calm_host_can_judge_has_a_twin_in_stepped_time_or_says_why_not() -> None:
    twins = set()
    tests = list(judged())
    assert len(tests) >= 8
    for name, marks in tests:
        assert len(marks) == 1, f"{name}: @pytest.mark.stepped_twin with the twin's node id, or none=why"
        (mark,) = marks
        named = {word.arg: ast.literal_eval(word.value) for word in mark.keywords}
        given = [ast.literal_eval(word) for word in mark.args]
        if not named.get("none"):
            twins.add(named.get("stepped") or given[0])
    files = sorted({twin.partition("::")[0] for twin in twins})
    found = run_pytest("--collect-only", "-m", "not alone", *files, cwd=ROOT)
    assert twins - {line.partition("[")[0] for line in found} == set(), "is no test of the first tier"


def test_the_closing_table_names_the_reason_and_the_twin(tmp_path: Path) -> None:
    (tmp_path / "conftest.py").write_text((ROOT / "tests/conftest.py").read_text())
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers = stepped_twin(node_id, none=why): twin\n")
    (tmp_path / "test_x.py").write_text("""
import pytest

@pytest.mark.stepped_twin("tests/stepped/test_y.py::test_z")
def test_of_real_processes():
    pytest.skip("the host stood still")

@pytest.mark.stepped_twin(none="it times a boot")
def test_of_machines():
    pytest.skip("no root")

@pytest.mark.skipif(True, reason="no openssl")
def test_of_another_kind():
    pass
""")
    lines = run_pytest(cwd=tmp_path)
    assert "test_x.py::test_of_real_processes | the host stood still | tests/stepped/test_y.py::test_z" in lines
    assert "test_x.py::test_of_machines | no root | no stepped twin: it times a boot" in lines
    assert "test_x.py::test_of_another_kind | no openssl | –" in lines
    assert lines[-1].startswith("3 skipped in "), "what CI reads stays the last line"
