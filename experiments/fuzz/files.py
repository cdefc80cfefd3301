"""Malformed files: each kind that a process or a command reads, mutated, and cut at every byte."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from random import Random
from typing import Any, Literal

from common.config import Config
from experiments.fuzz.mutate import HOSTILE_BYTES, spoilt, spoilt_json, spoilt_line, spoilt_toml
from experiments.fuzz.watch import BoundedCall, Tally

Form = Literal["json", "json lines", "toml", "override"]
_DAMAGED_LINES = 0.4


@dataclass(frozen=True, kw_only=True)
class FileKind:
    """A kind of file; functions of a module, so that another process can have it.

    Attributes:
        name: of the kind.
        file_name: under which it is read.
        form: what a mutation keeps to.
        example: a valid file.
        read: what a process does with it; returns what is wrong with the result, empty if nothing is.
        refuses: exceptions that refuse the file by name; none: it is never refused.
    """

    name: str
    file_name: str
    form: Form
    example: Callable[[Config], bytes]
    read: Callable[[Path, Config], str]
    refuses: tuple[type[Exception], ...] = ()


def run_file(kind: FileKind, config: Config, seed: int, count: int, until_s: float | None) -> Tally:
    """Read mutations of the kind's example.

    Args:
        kind: of file.
        config: the robots.
        seed: random seed.
        count: mutations.
        until_s: time.monotonic() after which nothing more is read; None: no such time.
    """
    random = Random(f"{kind.name} {seed}")
    return _read_all(kind, config, _mutations(kind, random, kind.example(config)), count, until_s)


def run_truncations(
    kind: FileKind, config: Config, begin: int, count: int, until_s: float | None, stride: int = 1
) -> Tally:
    """Read the example cut short, as a power cut may leave it: ended there, or NUL from there on.

    Args:
        kind: of file.
        config: the robots.
        begin: first byte at which it is cut.
        count: bytes of the example to go through.
        until_s: time.monotonic() after which nothing more is read; None: no such time.
        stride: bytes from one cut to the next.
    """
    example = kind.example(config)
    cuts = range(begin, min(begin + count, len(example)), stride)
    contents = (data for cut in cuts for data in (example[:cut], example[:cut] + b"\0" * min(64, len(example) - cut)))
    return _read_all(kind, config, contents, 2 * len(cuts), until_s)


def length(kind: FileKind, config: Config) -> int:
    """How many truncations there are; an override is a line of a command, which nothing cuts."""
    return 0 if kind.form == "override" else len(kind.example(config))


def _read_all(kind: FileKind, config: Config, contents: Iterator[bytes], count: int, until_s: float | None) -> Tally:
    watch = BoundedCall(kind.name, count, until_s)
    with tempfile.TemporaryDirectory(prefix="davpc-fuzz-") as folder:
        path = Path(folder) / kind.file_name
        while watch.goes_on:
            data = next(contents)
            path.write_bytes(data)
            watch.attempt(data, partial(kind.read, path, config), kind.refuses)
    return watch.finish()


def _mutations(kind: FileKind, random: Random, example: bytes) -> Iterator[bytes]:
    yield example
    yield from HOSTILE_BYTES
    tree: Any = json.loads(example) if kind.form == "json" else None
    lines = example.split(b"\n")
    while True:
        match kind.form:
            case "json":
                yield spoilt_json(random, tree)
            case "json lines":
                yield b"\n".join(_damaged(random, line) for line in lines)
            case "toml":
                yield spoilt_toml(random, example)
            case "override":
                line = spoilt_line(random, random.choice(lines).decode()).encode(errors="replace")
                yield line if random.random() < 0.7 else spoilt(random, line)


def _damaged(random: Random, line: bytes) -> bytes:
    if not line or random.random() > _DAMAGED_LINES:
        return line
    if random.random() < 0.3:
        return spoilt(random, line)
    return spoilt_json(random, json.loads(line)).replace(b"\n", b" ")
