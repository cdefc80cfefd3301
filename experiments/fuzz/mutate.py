"""Seeded mutations of values and bytes, and values that an annotation allows. Pure."""

from __future__ import annotations

import json
import math
import re
import string
from collections.abc import Sequence
from random import Random
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

_NUMBERS: tuple[Any, ...] = (0, 1, -1, 99, 100, 2**31, 2**53 + 1, 2**63 - 1, 2**63, 2**64 - 1, -(2**63), 0.5, -0.0)
_ODD_NUMBERS: tuple[Any, ...] = (1e9, -1e9, 1e154, 1e308, -1e308, 5e-324, float("nan"), float("inf"), -float("inf"))
_TEXTS = ("", "NaN", "1", "\0", "\n", "\u2028", "ß" * 100, "x" * 401, "x" * 5000, "self", "__init__", "attempt/2")
_SHAPES: tuple[Any, ...] = (
    [], {}, [[]], [None] * 4, [["a", "b"]] * 4, [[1.0, 2.0]] * 4, [[1.0]] * 13, {"self": 1}, {"x_m": 1}, {"": None},
)  # fmt: skip
HOSTILE: tuple[Any, ...] = (None, True, False, *_NUMBERS, *_ODD_NUMBERS, *_TEXTS, *_SHAPES)
HUGE: tuple[Any, ...] = (2**70, -(2**70), 10**400)
"""Integers that JSON and TOML can express and MessagePack cannot."""
NESTED = (b"[" * 50_000, b'{"a":' * 30_000, b"[" * 900 + b"]" * 900, b"9" * 6_000, b"x = " + b"[" * 3_000)
HOSTILE_BYTES = (b"", b"\0" * 100, b"\xff\xfe\0", b"\xef\xbb\xbf{}", b"null", b"[]", b"{}", b'""', b"\x80", *NESTED)
_LITERALS = (
    "0", "-1", "1e308", "nan", "inf", "-inf", "9" * 400, "9" * 5_000, "1e-300", "true", '""', '"x"', "[]", "{}",
    "{ x = 1 }", "1979-05-27", "9999-99-99", "0x7fffffffffffffff", "'''", "[" * 60 + "]" * 60, '"\\u0000"', "1_0",
    "[[]]", "",
)  # fmt: skip
_FACTORS = (0.0, 0.5, 0.9, 1.1, 2.0, 10.0, 1e6, -1.0)
_TOKEN = re.compile(r"-?\d+(?:\.\d+)?|\"[^\"]*\"|true|false")
_DEPTH_SHARE = 0.85


def mutated(random: Random, value: Any, hostile: Sequence[Any] = HOSTILE) -> Any:
    """The value with one part of it missing, added, doubled, moved or replaced; the value itself stays as it is."""
    if isinstance(value, dict) and value and random.random() < _DEPTH_SHARE:
        return _mutated_table(random, dict(value), hostile)
    if isinstance(value, list | tuple) and value and random.random() < _DEPTH_SHARE:
        return _mutated_list(random, list(value), hostile)
    if isinstance(value, int | float) and not isinstance(value, bool) and random.random() < 0.4:
        return random.choice((value + 1, value - 1, -value, value * 1000, str(value)))
    return random.choice(hostile)


def _mutated_table(random: Random, table: dict[Any, Any], hostile: Sequence[Any]) -> dict[Any, Any]:
    key = random.choice(list(table))
    match random.randrange(6):
        case 0:
            del table[key]
        case 1:
            table[random.choice(("zz", "self", "schema", "__init__", "", "x" * 500, "a\nb", "\u2028"))] = (
                random.choice(hostile)
            )
        case 2:
            table[key] = table[random.choice(list(table))]
        case _:
            table[key] = mutated(random, table[key], hostile)
    return table


def _mutated_list(random: Random, items: list[Any], hostile: Sequence[Any]) -> list[Any]:
    place = random.randrange(len(items))
    match random.randrange(5):
        case 0:
            del items[place]
        case 1:
            items.insert(place, random.choice(hostile))
        case 2:
            items.append(items[place])
        case _:
            items[place] = mutated(random, items[place], hostile)
    return items


def spoilt(random: Random, data: bytes) -> bytes:
    """The bytes with some of them flipped, missing, added, doubled, or all of them others."""
    changed = bytearray(data)
    for _ in range(random.choice((1, 1, 1, 2, 4))):
        place = random.randrange(len(changed) + 1)
        match random.randrange(6):
            case 0 | 1 if place < len(changed):
                changed[place] ^= 1 << random.randrange(8)
            case 2:
                del changed[place:]
            case 3:
                del changed[place : place + random.randrange(1, 9)]
            case 4:
                changed[place:place] = random.randbytes(random.randrange(1, 9))
            case 5:
                changed[place:place] = changed[place : place + random.randrange(1, 65)]
    return bytes(changed) if random.random() < 0.97 else random.choice(HOSTILE_BYTES)


def spoilt_json(random: Random, value: Any) -> bytes:
    """A JSON text of the mutated value; now and then of a mutated text."""
    hostile = (*HOSTILE, *HUGE)
    for _ in range(random.randrange(1, 4)):
        value = mutated(random, value, hostile)
    data = json.dumps(value, ensure_ascii=random.random() < 0.5).encode(errors="replace")
    return data if random.random() < 0.7 else spoilt(random, data)


def spoilt_toml(random: Random, data: bytes) -> bytes:
    """A TOML text with lines missing, doubled or moved, and values replaced; now and then with other bytes."""
    lines = data.decode().split("\n")
    for _ in range(random.choice((1, 1, 2, 3))):
        place = random.randrange(len(lines))
        match random.randrange(6):
            case 0:
                del lines[place]
            case 1:
                lines.insert(random.randrange(len(lines)), lines[place])
            case 2:
                lines.insert(place, f"{random.choice(('zz', 'a.' * 300 + 'a', '[x]', '[[x]]'))} = 1")
            case _:
                lines[place] = spoilt_line(random, lines[place])
        lines = lines or [""]
    text = "\n".join(lines).encode(errors="replace")
    return text if random.random() < 0.85 else spoilt(random, text)


def spoilt_line(random: Random, line: str) -> str:
    """One value of a line replaced by a literal; the whole line where it has none."""
    found = list(_TOKEN.finditer(line))
    if not found:
        return random.choice(_LITERALS)
    token = random.choice(found)
    literal = random.choice(_LITERALS)
    if token.group()[-1].isdigit() and random.random() < 0.4:
        number = float(token.group()) * random.choice(_FACTORS)
        whole = "." not in token.group() and math.isfinite(number)
        literal = str(int(number)) if whole else repr(number)
    return line[: token.start()] + literal + line[token.end() :]


def allowed(random: Random, annotation: Any) -> Any:
    """A value that an annotation of a message's field allows; bounds as often as what is between them."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _bounded(random, arguments[0], [m for info in arguments[1:] for m in info.metadata])
    if origin is tuple:
        return tuple(allowed(random, argument) for argument in arguments)
    if origin in (Union, UnionType):
        return allowed(random, random.choice(arguments))
    if origin is Literal:
        return random.choice(arguments)
    if annotation is float:
        return random.choice((0.0, 1e308, random.uniform(-1.0, 1.0), random.uniform(-1e6, 1e6)))
    if annotation is bool:
        return random.random() < 0.5
    if annotation is type(None):
        return None
    raise TypeError(f"no values for {annotation}")


def _bounded(random: Random, kind: Any, bounds: Sequence[Any]) -> Any:
    limits = {type(bound).__name__: bound for bound in bounds}
    if kind in (int, float):
        low = limits["Ge"].ge if "Ge" in limits else limits["Gt"].gt + 1e-6 if "Gt" in limits else -1_000_000_000
        high = limits["Le"].le if "Le" in limits else limits["Lt"].lt - 1 if "Lt" in limits else 1_000_000_000
        if kind is int:
            return random.choice((low, high, random.randint(low, min(high, low + 1000)), random.randint(low, high)))
        return float(random.choice((low, high, random.uniform(low, high), random.uniform(low, high))))
    least = limits["MinLen"].min_length if "MinLen" in limits else 0
    most = limits["MaxLen"].max_length
    size = random.choice((least, most, random.randint(least, most)))
    if kind is str:
        return "".join(random.choices(string.printable + "ß€\u2028\0", k=min(size, random.choice((size, 12)))) or "x")
    item = get_args(kind)[0]
    return tuple(allowed(random, item) for _ in range(size))
