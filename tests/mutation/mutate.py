"""Mutation test of what decides about motion: change a module in one place at a time; do its tests notice?

``python -m tests.mutation.mutate`` takes every module of ``targets.py``, or those that are named. It prints each
survivor, and exits with 1 if ``survivors.txt`` does not list one under its reason, or lists one that is noticed after
all or does not exist any more.
"""

from __future__ import annotations

import ast
import os
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated

import typer

from tests.mutation.operators import Mutant, mutants
from tests.mutation.runner import Target
from tests.mutation.targets import TARGETS

ACCEPTED = Path(__file__).parent / "survivors.txt"
Jobs = Annotated[int, typer.Option(help="Mutants at a time; 0: one for each core.", min=0)]
Modules = Annotated[list[str] | None, typer.Argument(help="Parts of paths of modules; none: all.")]


def main(modules: Modules = None, jobs: Jobs = 0) -> None:
    """Mutate modules and report the survivors."""
    os.environ["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"
    chosen = [path for path in TARGETS if not modules or any(part in path for part in modules)]
    unexplained = sum(_module(Path(path), jobs or os.cpu_count() or 1) for path in chosen)
    if not chosen:
        sys.exit(f"no module of tests/mutation/targets.py is named like {modules}")
    sys.exit(int(unexplained > 0))


def _module(path: Path, jobs: int) -> int:
    """Number of wrong entries of one module: survivors listed nowhere, and listed mutants that do not survive."""
    began_s = time.monotonic()
    listed = {(where, what): reason for (at, where, what), reason in accepted().items() if at == str(path)}
    tried, new, stale = 0, 0, set(listed)
    for mutant, noticed in _noticed(Target(path, TARGETS[str(path)]), jobs):
        tried += 1
        if noticed:
            continue
        key = mutant.where, mutant.what
        stale.discard(key)
        new += key not in listed
        row = f"{path}:{mutant.lines[0]}\t{mutant.where}\t{mutant.what}\t{listed.get(key, 'SURVIVED')}"
        print(row, flush=True)  # noqa: T201
    for where, what in sorted(stale):
        print(f"{path}\t{where}\t{what}\tlisted, but noticed or gone: delete the entry")  # noqa: T201
    spent_s = time.monotonic() - began_s
    summary = (
        f"{tried} mutants, {len(listed) - len(stale)} survivors with a reason, {new} without, {len(stale)} stale"
    )
    print(f"{path}: {summary}, {spent_s:.0f} s", flush=True)  # noqa: T201
    return new + len(stale)


def accepted() -> dict[tuple[str, str, str], str]:
    """Module, function and change of each accepted survivor, with the reason above it in ``survivors.txt``."""
    found, reason = {}, ""
    for row in ACCEPTED.read_text(encoding="utf-8").splitlines():
        if row.startswith("# "):
            reason = row.removeprefix("# ")
        else:
            path, where, what = row.split("\t")
            found[path, where, what] = reason
    return found


def _noticed(target: Target, jobs: int) -> Iterator[tuple[Mutant, str]]:
    """Each mutant with the test that notices it, empty for a survivor; several run at a time."""
    reach = target.reach()
    running: deque[tuple[Mutant, Callable[[], str]]] = deque()
    killer = ""
    for mutant in mutants(ast.parse(target.source)):
        running.append((mutant, target.start(mutant, reach, killer)))
        if len(running) >= jobs:
            oldest, result = running.popleft()
            noticed = result()
            killer = noticed or killer
            yield oldest, noticed
    for mutant, result in running:
        yield mutant, result()


if __name__ == "__main__":
    typer.run(main)
