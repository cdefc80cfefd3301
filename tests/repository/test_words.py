"""Code, tests and documents use the field's words: commanded, reported, the operator, again."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

ROOT = Path(__file__).parents[2]
ROOMS = ("common", "follower", "gateway", "leader", "sim", "station", "experiments", "tests")
AVOIDED = re.compile(r"\b(?:told|somebody|nobody|anew|a\s+person)\b", re.IGNORECASE)


def avoided(paths: Iterable[Path]) -> list[str]:
    """Place and words, also where a line break parts them."""
    return [
        f"{path.relative_to(ROOT)}:{text.count(chr(10), 0, found.start()) + 1}: {found[0]}"
        for path in paths
        for text in (path.read_text(encoding="utf-8").replace("_", " "),)
        for found in AVOIDED.finditer(text)
    ]


def test_what_code_and_tests_say() -> None:
    assert (
        avoided(path for room in ROOMS for path in sorted((ROOT / room).rglob("*.py")) if path != Path(__file__))
        == []
    )


def test_what_the_pages_say() -> None:
    """CONTRIBUTING.md shows what to avoid."""
    assert avoided((ROOT / "README.md", ROOT / "ARCHITECTURE.md", *sorted((ROOT / "docs").rglob("*.md")))) == []


def test_the_words_are_found() -> None:
    page = ROOT / "CONTRIBUTING.md"
    assert any(line.endswith("somebody") for line in avoided([page]))
