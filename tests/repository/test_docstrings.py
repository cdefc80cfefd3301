"""What the caller of a function with many parameters, or with an array, has to know stands in its docstring."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("common", "follower", "gateway", "leader", "sim", "station", "experiments")
MANY = 4
ARRAYS = {"Array", "Image", "NDArray", "Mask"}
# a command's parameters are explained by its help, a property's by what it returns, an override's by its base
EXPLAINED_ELSEWHERE = ("command", "callback", "property", "override")


def public_functions(node: ast.Module | ast.ClassDef) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    """Functions and methods whose names, and those of their classes, do not begin with an underscore."""
    for part in node.body:
        if isinstance(part, ast.ClassDef) and not part.name.startswith("_"):
            yield from public_functions(part)
        elif isinstance(part, ast.FunctionDef | ast.AsyncFunctionDef) and not part.name.startswith("_"):
            decorators = " ".join(ast.unparse(each) for each in part.decorator_list)
            if not any(word in decorators for word in EXPLAINED_ELSEWHERE):
                yield part


def needs_args(function: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    """Whether it has many parameters, or an array among them."""
    given = function.args
    parameters = [
        each for each in (*given.posonlyargs, *given.args, *given.kwonlyargs) if each.arg not in ("self", "cls")
    ]
    types = [ast.unparse(each.annotation).strip("'") for each in parameters if each.annotation is not None]
    return len(parameters) >= MANY or any(ARRAYS & set(text.split("[")[0].split(" ")) for text in types)


def test_many_parameters_and_arrays_are_explained() -> None:
    missing = [
        f"{path.relative_to(ROOT)}:{function.lineno} {function.name}"
        for package in PACKAGES
        for path in sorted((ROOT / package).rglob("*.py"))
        for function in public_functions(ast.parse(path.read_text()))
        if needs_args(function) and "Args:" not in (ast.get_docstring(function) or "")
    ]
    assert missing == [], "Args: with meaning, shapes, units and frames"


def test_the_rule_itself_notices() -> None:
    source = """
def four(a, b, c, d): ...
def array(image: Image[int]): ...
def few(a, b, c): ...
def _private(a, b, c, d): ...
class Many:
    def method(self, a, b, c, *, d): ...
    @property
    def value(self, a, b, c, d): ...
"""
    found = [function.name for function in public_functions(ast.parse(source)) if needs_args(function)]
    assert found == ["four", "array", "method"]
