"""JSON and TOML from files that a hand, a power cut or a stranger may have changed: read whole, or refused by name.

Both parsers raise more than their documentation says (a nesting deeper than the interpreter's stack, an integer of
five thousand digits), and JSON as Python reads it knows NaN and Infinity. Here everything that is wrong with a text
is one error with one line.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

MOST_BYTES = 16_000_000
MOST_DEPTH = 40


class UnreadableError(ValueError):
    """A text that is not what it should be; one line that says why."""


def one_line(text: str, most: int = 200) -> str:
    """What a stranger wrote, fit for a log or a message: not printable characters replaced, cut to ``most``."""
    return "".join(c if c.isprintable() else "?" for c in text[:most])


def read_text(path: Path) -> str:
    """A UTF-8 file, with or without a byte order mark.

    Raises:
        OSError: as the system says.
        UnreadableError: it is larger than any file of davpc, or not UTF-8.
    """
    with path.open("rb") as file:
        data = file.read(MOST_BYTES + 1)
    if len(data) > MOST_BYTES:
        raise UnreadableError(f"larger than {MOST_BYTES // 1_000_000} MB")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        raise UnreadableError(f"line {line} is not UTF-8: save it with that encoding") from error


def parse_json(text: str) -> Any:
    """The value of a JSON text, without NaN and Infinity.

    Raises:
        UnreadableError: it is not JSON.
    """
    return _parsed(lambda: json.loads(text, parse_constant=_refuse_constant), "JSON")


def parse_toml(text: str) -> dict[str, Any]:
    """The table of a TOML text.

    Raises:
        UnreadableError: it is not TOML.
    """
    table: dict[str, Any] = _parsed(lambda: tomllib.loads(text), "TOML")
    return table


def _parsed(parse: Callable[[], Any], kind: str) -> Any:
    try:
        value = parse()
    except RecursionError as error:
        raise UnreadableError(f"not valid {kind}: nested too deeply") from error
    except ValueError as error:
        raise UnreadableError(f"not valid {kind}: {str(error)[:200]}") from error
    if _deep(value):
        raise UnreadableError(f"not valid {kind}: nested too deeply")
    return value


def _deep(value: Any) -> bool:
    """Whether it is nested deeper than what reads it may follow."""
    level = [value]
    for _ in range(MOST_DEPTH):
        level = [
            item
            for each in level
            if isinstance(each, dict | list)
            for item in (each.values() if isinstance(each, dict) else each)
        ]
        if not level:
            return False
    return True


def _refuse_constant(name: str) -> Any:
    raise ValueError(f"{name} is not a number")
