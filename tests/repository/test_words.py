"""What a user reads uses the field's words: commanded, reported, the operator, again."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("common", "follower", "gateway", "leader", "sim", "station", "experiments")
AVOIDED = re.compile(r"\b(?:told|somebody|nobody|anew|a\s+person)\b", re.IGNORECASE)


def literals(source: str) -> Iterator[tuple[int, str]]:
    """Line and text of every string literal that is no docstring."""
    tree = ast.parse(source)
    silent = {node.value for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in silent:
            yield node.lineno, node.value


def commands_help(source: str) -> Iterator[tuple[int, str]]:
    """Line and text of the docstrings of commands: they are their help."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef) and any("command" in ast.unparse(each) for each in node.decorator_list):
            yield node.lineno, ast.get_docstring(node) or ""


def test_what_the_product_says() -> None:
    said = [
        f"{path.relative_to(ROOT)}:{line}: {text}"
        for package in PACKAGES
        for path in sorted((ROOT / package).rglob("*.py"))
        for line, text in (*literals(path.read_text()), *commands_help(path.read_text()))
        if AVOIDED.search(text)
    ]
    assert said == []


def test_what_the_pages_say() -> None:
    said = [
        f"{page.relative_to(ROOT)}:{number}: {line}"
        for page in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
        for number, line in enumerate(page.read_text().splitlines(), start=1)
        if AVOIDED.search(line)
    ]
    assert said == []


def test_the_rule_itself_notices() -> None:
    source = (
        '"""Told in a docstring."""\nx = f"LED {x}: told"\n\n@app.command()\ndef f():\n    """A person reads it."""\n'
    )
    assert [text for _, text in literals(source) if AVOIDED.search(text)] == [": told"]
    assert [text for _, text in commands_help(source)] == ["A person reads it."]
    assert AVOIDED.search("a\nperson")
    assert not AVOIDED.search("is a personal one")
