"""What the mutation test accepts is there, and has a reason; the run itself is ``make mutate``."""

from __future__ import annotations

import ast
from pathlib import Path

from tests.mutation.mutate import accepted
from tests.mutation.operators import mutants
from tests.mutation.targets import TARGETS


def test_every_module_of_the_supervisor_but_its_reports_is_mutated() -> None:
    modules = {str(path) for path in Path("follower/supervisor").rglob("*.py") if path.name != "__init__.py"}
    reports = {"follower/supervisor/attempt_report.py", "follower/supervisor/journal.py"}
    assert modules - reports <= set(TARGETS)
    assert all(Path(test).is_file() for tests in TARGETS.values() for test in tests)


def test_every_accepted_survivor_is_a_mutant_of_today_with_a_reason() -> None:
    assert all(accepted().values())
    for path in TARGETS:
        listed = {(where, what) for at, where, what in accepted() if at == path}
        tree = ast.parse(Path(path).read_text(encoding="utf-8"))
        assert listed <= {(mutant.where, mutant.what) for mutant in mutants(tree)}, path


def test_mutants_change_one_place_at_a_time_and_leave_words_for_people() -> None:
    source = (
        'def slow(v: float) -> str:\n    """Say so."""\n    return f"too fast: {v}" if v > 0.5 else "all is well"\n'
    )
    tree = ast.parse(source)
    found = list(mutants(tree))
    assert ast.unparse(tree) == ast.unparse(ast.parse(source))
    assert [mutant.what.partition("  →  ")[2] for mutant in found if mutant.where == "slow"] == [
        "f'too fast: {v}' if False else 'all is well'",
        "v >= 0.5",
        "v < 0.5",
        "f''",
        "''",
        "1.5",
        "0.51",
    ]
    assert {mutant.lines for mutant in found} == {(3, 3)}
