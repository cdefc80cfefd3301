"""Every way in which one module is changed in one place: operators, constants, conditions, calls, dropped statements.

Wording for people is not a behaviour: a text becomes empty, which is one; its cause code, a rule's name or any other
identifier becomes another one.
"""

from __future__ import annotations

import ast
import contextlib
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

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


_CAUSE: Final = re.compile(r"[a-z_0-9]+(: |$)")


@dataclass(frozen=True, kw_only=True)
class Mutant:
    """One change.

    Attributes:
        where: qualified name of the function or class around it; empty at the module's level.
        what: the changed part before and after; repeated ones of one function are numbered.
        lines: first and last line of the statement, without the body of a compound one.
        source: the changed module.
    """

    where: str
    what: str
    lines: tuple[int, int]
    source: str


def mutants(tree: ast.Module) -> Iterator[Mutant]:
    """Every mutant of a module; the tree is as before after each."""
    places = dict(_places(tree))
    seen: Counter[tuple[str, str]] = Counter()
    for node, what in _changes(tree, set(_untouched(tree))):
        where, lines = places[node]
        seen[where, what] += 1
        number = seen[where, what]
        numbered = what if number == 1 else f"{what}  #{number}"
        yield Mutant(where=where, what=numbered, lines=lines, source=ast.unparse(ast.fix_missing_locations(tree)))


def _changes(tree: ast.Module, untouched: set[ast.AST]) -> Iterator[tuple[ast.AST, str]]:
    """The changed node and how it changed; the tree stays changed until the next one is asked for."""
    for node in list(ast.walk(tree)):
        if node in untouched or isinstance(node, ast.Module):
            continue
        before = ast.unparse(node)
        for variant in range(4):
            with _restored(node):
                if not _change(node, variant):
                    break
                yield node, f"{_short(before)}  →  {_short(ast.unparse(node))}"
        if not isinstance(node, ast.ClassDef):
            yield from _without_statements(node)


def _without_statements(node: ast.AST) -> Iterator[tuple[ast.AST, str]]:
    """Statements with an effect are left out one at a time."""
    for name in ("body", "orelse"):
        body = getattr(node, name, None)
        for i, statement in enumerate(list(body) if isinstance(body, list) else ()):
            call = isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Call)
            if call or isinstance(statement, ast.Assign | ast.AugAssign):
                with _restored(node):
                    getattr(node, name)[i] = ast.Pass()
                    yield statement, f"without {_short(ast.unparse(statement))}"


def _untouched(tree: ast.Module) -> Iterator[ast.AST]:
    """Decorators, docstrings, annotations, and the parts of a formatted text but its cause code."""
    for node in ast.walk(tree):
        people: list[ast.AST | None] = [*getattr(node, "decorator_list", ()), getattr(node, "annotation", None)]
        people.append(getattr(node, "returns", None))
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            people.append(node.value)
        if isinstance(node, ast.JoinedStr):
            texts = [part for part in node.values if isinstance(part, ast.Constant)]
            people += [part for part in texts if part is not node.values[0] or not _CAUSE.match(str(part.value))]
            people += [part.format_spec for part in node.values if isinstance(part, ast.FormattedValue)]
        if isinstance(node, ast.Subscript) and ast.unparse(node.value) == "Literal":
            people.append(node)
        if isinstance(node, ast.keyword) and node.arg == "strict":
            people.append(node)  # of zip: no mistake of the code around it, but a check of the types
        if isinstance(node, ast.If) and ast.unparse(node.test) == "__name__ == '__main__'":
            people.append(node)
        for each in people:
            yield from ast.walk(each) if each is not None else ()


def _places(
    node: ast.AST, where: str = "", lines: tuple[int, int] = (0, 0)
) -> Iterator[tuple[ast.AST, tuple[str, tuple[int, int]]]]:
    """Of each node: the function or class around it, and the lines of its statement."""
    if isinstance(node, ast.stmt):
        body = getattr(node, "body", None)
        last = body[0].lineno - 1 if body else node.end_lineno or node.lineno
        lines = (node.lineno, max(node.lineno, last))
    yield node, (where, lines)
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        where = f"{where}.{node.name}" if where else node.name
    for child in ast.iter_child_nodes(node):
        yield from _places(child, where, lines)


def _short(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= 70 else line[:67] + "…"


@contextlib.contextmanager
def _restored(node: ast.AST) -> Iterator[None]:
    """Put the node back as it was, lists of children included."""
    saved = {key: list(value) if isinstance(value, list) else value for key, value in vars(node).items()}
    try:
        yield
    finally:
        vars(node).update(saved)


def _change(node: ast.AST, variant: int) -> bool:
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
    if isinstance(node, ast.JoinedStr):
        node.values = []
        return True
    if isinstance(node, ast.Constant):
        return _constant(node)
    return False


def _unary(node: ast.UnaryOp) -> bool:
    if isinstance(node.op, ast.Not):
        node.op, node.operand = ast.Not(), ast.UnaryOp(op=ast.Not(), operand=node.operand)
        return True
    if isinstance(node.op, ast.USub):
        node.op = ast.UAdd()
        return True
    return False


def _constant(node: ast.Constant) -> bool:
    if isinstance(node.value, bool):
        node.value = not node.value
    elif isinstance(node.value, int | float):
        node.value += 1
    elif isinstance(node.value, str):
        node.value = _other_text(node.value)
    else:
        return False
    return True


def _other_text(text: str) -> str:
    """Another identifier or cause code; a text without one becomes empty."""
    if " " in text and not _CAUSE.match(text):
        return ""
    return "X" + text


def _scale(node: ast.Constant) -> bool:
    """Constants also by a little, so that tests have to know their exact value."""
    if isinstance(node.value, float) and node.value:
        node.value *= 1.02
        return True
    return False
