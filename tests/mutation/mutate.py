"""Mutation test of one module: change it in one place at a time and check whether its tests notice.

``python -m tests.mutation.mutate follower/can_bridge/gate.py tests/unit/follower/can_bridge/test_gate.py …`` prints
every survivor and exits with 1 if there is one that ``EQUIVALENT`` does not list with its reason.
"""

from __future__ import annotations

import ast
import contextlib
import importlib
import io
import os
import resource
import sys
import types
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from tests.mutation.equivalent import EQUIVALENT

CPU_LIMIT_S = 60
"""Of one run of the tests, which take a second: more is an endless loop. By CPU time, whatever else runs here."""
_QUICK = ("-x", "-q", "--assert=plain", "-p", "no:cacheprovider", "-c", os.devnull, f"--rootdir={Path.cwd()}")
_COMPARISONS: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.Gt),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.Lt),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
_ARITHMETIC: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
}
_CALLS = {"min": "max", "max": "min", "abs": "float"}


def mutants(tree: ast.Module) -> Iterator[tuple[int, str, str]]:
    """Line, description and source of every mutant: operators, constants, conditions, calls, dropped statements."""
    decorators = {
        part for node in ast.walk(tree) for each in getattr(node, "decorator_list", ()) for part in ast.walk(each)
    }
    for node in list(ast.walk(tree)):
        if node in decorators:
            continue
        before = ast.unparse(node) if not isinstance(node, ast.Module) else ""
        for variant in range(4):
            with _restored(node):
                if not _change(tree, node, variant):
                    break
                ast.fix_missing_locations(tree)
                yield getattr(node, "lineno", 0), f"{before}  →  {ast.unparse(node)}"[:150], ast.unparse(tree)
        if not isinstance(node, ast.Module | ast.ClassDef):
            yield from _without_statements(tree, node)


def _without_statements(tree: ast.Module, node: ast.AST) -> Iterator[tuple[int, str, str]]:
    """Statements with an effect are left out one at a time."""
    for name in ("body", "orelse"):
        body = getattr(node, name, None)
        for i, statement in enumerate(list(body) if isinstance(body, list) else ()):
            call = isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Call)
            if call or isinstance(statement, ast.Assign | ast.AugAssign):
                with _restored(node):
                    getattr(node, name)[i] = ast.Pass()
                    yield statement.lineno, f"without {ast.unparse(statement)}"[:150], ast.unparse(tree)


@contextlib.contextmanager
def _restored(node: ast.AST) -> Iterator[None]:
    """Put the node back as it was, lists of children included."""
    saved = {key: list(value) if isinstance(value, list) else value for key, value in vars(node).items()}
    try:
        yield
    finally:
        vars(node).update(saved)


def _change(tree: ast.Module, node: ast.AST, variant: int) -> bool:
    """Apply the ``variant``-th mutation of this node; false when it has no such one."""
    if isinstance(node, ast.Compare):
        options = [(i, op) for i, old in enumerate(node.ops) for op in _COMPARISONS.get(type(old), ())]
        if variant < len(options):
            node.ops[options[variant][0]] = options[variant][1]()
            return True
        return False
    if variant:
        return isinstance(node, ast.Constant) and variant == 1 and _scale(node)
    if isinstance(node, ast.BinOp) and type(node.op) in _ARITHMETIC:
        node.op = _ARITHMETIC[type(node.op)]()
        return True
    if isinstance(node, ast.BoolOp):
        node.op = ast.Or() if isinstance(node.op, ast.And) else ast.And()
        return True
    if isinstance(node, ast.UnaryOp):
        return _unary(node)
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in _CALLS:
        node.func = ast.Name(id=_CALLS[node.func.id], ctx=ast.Load())
        return True
    if isinstance(node, ast.IfExp | ast.If | ast.While):
        node.test = ast.Constant(value=False)
        return True
    if isinstance(node, ast.Constant):
        return _constant(tree, node)
    return False


def _unary(node: ast.UnaryOp) -> bool:
    if isinstance(node.op, ast.Not):
        node.op, node.operand = ast.Not(), ast.UnaryOp(op=ast.Not(), operand=node.operand)
        return True
    if isinstance(node.op, ast.USub):
        node.op = ast.UAdd()
        return True
    return False


def _constant(tree: ast.Module, node: ast.Constant) -> bool:
    if isinstance(node.value, bool):
        node.value = not node.value
    elif isinstance(node.value, int | float):
        node.value += 1
    elif isinstance(node.value, str) and not _is_text(tree, node):
        node.value = node.value + "X"
    else:
        return False
    return True


def _scale(node: ast.Constant) -> bool:
    """Constants also by a little, so that tests have to know their exact value."""
    if isinstance(node.value, float) and node.value:
        node.value *= 1.02
        return True
    return False


def _is_text(tree: ast.Module, node: ast.Constant) -> bool:
    """Docstrings and annotations are for people."""
    return any(isinstance(parent, ast.Expr) and parent.value is node for parent in ast.walk(tree))


def survives(source: str, name: str, tests: Sequence[str]) -> bool:
    """Run the tests against the changed module in a process of its own; true when all still pass."""
    child = os.fork()
    if child:
        _, status = os.waitpid(child, 0)
        return status == 0
    resource.setrlimit(resource.RLIMIT_CPU, (CPU_LIMIT_S, CPU_LIMIT_S))
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        try:
            module = types.ModuleType(name)
            sys.modules[name] = module
            exec(compile(source, name, "exec"), module.__dict__)
            result = pytest.main([*_QUICK, *tests])
        except BaseException:  # noqa: BLE001 - a mutant that cannot even be loaded is killed
            os._exit(1)
    os._exit(0 if result == pytest.ExitCode.OK else 1)


def main(arguments: Sequence[str]) -> int:
    """Mutate the module given first; the tests that must notice follow."""
    path, tests = Path(arguments[0]), list(arguments[1:])
    name = ".".join(path.with_suffix("").parts)
    os.environ["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for test in ("tests/conftest.py", *tests):
        importlib.import_module(".".join(Path(test).with_suffix("").parts))
    for loaded in [name for name in sys.modules if name.startswith("tests.") and "mutation" not in name]:
        del sys.modules[loaded]  # tests and their rigs are imported again, over the mutant
    if not survives(ast.unparse(tree), name, tests):
        sys.stdout.write("the tests fail on the module as it is\n")
        return 1
    tried, left = 0, 0
    for line, what, mutant in mutants(tree):
        tried += 1
        if tried % 50 == 0:
            sys.stderr.write(f"{tried} mutants, line {line}\n")
        if not survives(mutant, name, tests):
            continue
        reason = EQUIVALENT.get((path.name, what), "")
        left += not reason
        sys.stdout.write(f"{path}:{line}: {'equivalent: ' + reason if reason else 'SURVIVED'}: {what}\n")
        sys.stdout.flush()
    sys.stdout.write(f"{path}: {tried} mutants, {left} survivors\n")
    return int(left > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
