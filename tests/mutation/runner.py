"""Run tests on a changed module, in a process of its own: which reach which line, and whether one of them fails.

The modules that import the changed one, directly or not, are imported again over it. A test that never reaches the
changed statement cannot notice it and is not run.
"""

from __future__ import annotations

import ast
import contextlib
import importlib
import io
import json
import os
import resource
import sys
import types
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import coverage
import pytest

from tests.mutation.operators import Mutant

_OPTIONS = ("-x", "-q", "--assert=plain", "-p", "no:cacheprovider", "-c", os.devnull, f"--rootdir={Path.cwd()}")
_OURS = ("common", "follower", "leader", "gateway", "sim", "station", "experiments", "tests")


@dataclass(frozen=True, kw_only=True)
class Reach:
    """What the unchanged module's tests did: seconds of each, and the tests that reached each line.

    Lines that ran at import are reached by all.
    """

    seconds: dict[str, float]
    by_line: dict[int, set[str]]

    def tests(self, mutant: Mutant, first: str) -> list[str]:
        """The tests that could notice it, quickest first, but ``first`` at the beginning."""
        first_line, last_line = mutant.lines
        found: set[str] = set()
        for line in range(first_line, last_line + 1):
            found |= self.by_line.get(line, set())
        if "" in found or not mutant.where:
            found = set(self.seconds)
        return sorted(found & set(self.seconds), key=lambda test: (test != first, self.seconds[test]))


class _Watch:
    """Plugin: the context of the coverage is the running test; its duration; the first that fails."""

    def __init__(self, cover: coverage.Coverage | None = None) -> None:
        self.cover = cover
        self.seconds: dict[str, float] = {}
        self.failed = ""

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        if self.cover is not None:
            self.cover.switch_context(nodeid)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.seconds[report.nodeid] = self.seconds.get(report.nodeid, 0.0) + report.duration
        if report.failed:
            self.failed = self.failed or report.nodeid


class Target:
    """One module with the tests that must notice its changes."""

    def __init__(self, path: Path, tests: Sequence[str]) -> None:
        self.path, self.tests = path, tests
        self.name = ".".join(path.with_suffix("").parts)
        self.source = path.read_text(encoding="utf-8")
        for test in ("tests/conftest.py", *tests):
            importlib.import_module(".".join(Path(test).with_suffix("").parts))
        self._dependents = dependents(self.name)

    def reach(self) -> Reach:
        """Run the tests on the module as it is.

        Raises:
            RuntimeError: they fail.
        """
        found = _in_child(self._measure)()
        failed = "its process ended" if found is None else found["failed"]
        if found is None or failed:
            raise RuntimeError(f"the tests of {self.path} fail on the module as it is: {failed}")
        by_line = {int(line): set(tests) for line, tests in found["lines"].items()}
        return Reach(seconds=found["seconds"], by_line=by_line)

    def start(self, mutant: Mutant, reach: Reach, first: str) -> Callable[[], str]:
        """Begin to run the tests on a mutant; the result waits for the test that notices it, empty: none does."""
        tests = reach.tests(mutant, first)
        if not tests:
            return lambda: ""
        limit_s = 5 + round(5 * sum(map(reach.seconds.__getitem__, tests)))
        found = _in_child(lambda: self._try(mutant, tests, limit_s))

        def noticed() -> str:
            result = found()
            return str(result["failed"]) if result is not None else "no test: it ended the process or took too long"

        return noticed

    def _measure(self) -> dict[str, Any]:
        self._forget()
        cover = coverage.Coverage(data_file=None, include=[str(self.path)], config_file=False)
        watch = _Watch(cover)
        cover.start()
        result = pytest.main([*_OPTIONS, *self.tests], plugins=[watch])
        cover.stop()
        lines = cover.get_data().contexts_by_lineno(str(self.path.resolve()))
        failed = watch.failed or ("" if result == pytest.ExitCode.OK else str(result))
        return {"failed": failed, "seconds": watch.seconds, "lines": lines}

    def _try(self, mutant: Mutant, tests: Sequence[str], limit_s: int) -> dict[str, Any]:
        resource.setrlimit(resource.RLIMIT_CPU, (limit_s, limit_s))  # an endless loop; whatever else runs here
        self._forget()
        module = types.ModuleType(self.name)
        sys.modules[self.name] = module
        parent, _, own = self.name.rpartition(".")
        setattr(importlib.import_module(parent), own, module)
        exec(compile(mutant.source, str(self.path), "exec"), module.__dict__)
        watch = _Watch()
        result = pytest.main([*_OPTIONS, *tests], plugins=[watch])
        return {"failed": watch.failed or ("" if result == pytest.ExitCode.OK else "collection")}

    def _forget(self) -> None:
        for name in self._dependents:
            sys.modules.pop(name, None)


def dependents(name: str) -> list[str]:
    """The loaded modules that import this one, directly or not, itself among them; and all tests."""
    imports = {
        loaded: set(_imported(module))
        for loaded, module in list(sys.modules.items())
        if loaded.split(".")[0] in _OURS
    }
    found = {name, *(each for each in imports if each.startswith("tests.") and "mutation" not in each)}
    while more := {each for each, used in imports.items() if used & found} - found:
        found |= more
    return sorted(each for each in found if "mutation" not in each)


def _imported(module: types.ModuleType) -> Iterable[str]:
    source = getattr(module, "__file__", None)
    if not source:
        return
    for node in ast.walk(ast.parse(Path(source).read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def _in_child(work: Callable[[], dict[str, Any]]) -> Callable[[], dict[str, Any] | None]:
    """Begin ``work`` in a process of its own; calling the result waits for what it returned, None if it died."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reader)
        status = 1
        try:
            with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
                result = work()
            with os.fdopen(writer, "w") as pipe:
                json.dump(result, pipe)
            status = 0
        finally:
            os._exit(status)
    os.close(writer)

    def wait() -> dict[str, Any] | None:
        with os.fdopen(reader) as pipe:
            text = pipe.read()
        _, status = os.waitpid(child, 0)
        return json.loads(text) if status == 0 else None

    return wait
