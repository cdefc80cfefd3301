"""Journaled steps, unpacked and checked: a file may hold anything."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import msgpack
from pydantic import TypeAdapter, ValidationError

from common.messages import StepJournal

_State = tuple[int, int, int]  # channel, CRC-32 of the payload, receipt
_Taken = tuple[int, bool, bytes, int]  # channel, whether it is an answer, payload, receipt
_Call = tuple[int, int, Any]  # device and method, form, result
_Output = tuple[int, tuple[int, int, int] | bytes]  # channel; sequence, stamp, CRC-32, or the payload itself
_Step = tuple[int, list[_State], list[_Taken], list[int], list[_Call], list[tuple[int, int]], list[_Output]]
_STEP: TypeAdapter[_Step] = TypeAdapter(_Step)


class JournalError(ValueError):
    """A journal that cannot be read; one line that says why."""


@dataclass(frozen=True)
class Seen:
    """A state that a step saw for the first time: found again by the CRC-32 of its bytes."""

    key: str
    crc: int
    receipt_ns: int


@dataclass(frozen=True)
class Taken:
    """A request or an answer that a step took."""

    key: str
    is_answer: bool
    payload: bytes
    receipt_ns: int


@dataclass(frozen=True)
class Sent:
    """An output: of one that crosses the bus its header's numbers and CRC-32; any other itself."""

    key: str
    sequence: int
    stamp_ns: int
    crc: int
    payload: bytes | None


@dataclass(frozen=True)
class JournaledStep:
    """One step of a node."""

    number: int
    now_ns: int
    states: tuple[Seen, ...]
    taken: tuple[Taken, ...]
    reads_ns: tuple[int, ...]
    calls: tuple[tuple[str, int, Any], ...]
    late: dict[str, int]
    outputs: tuple[Sent, ...]


def steps_of(journal: StepJournal) -> Iterator[JournaledStep]:
    """The steps of a batch.

    Raises:
        JournalError: it is damaged, or of another version.
    """
    unpacker = msgpack.Unpacker(use_list=False, max_buffer_size=len(journal.steps) + 1)
    unpacker.feed(journal.steps)
    try:
        for offset in range(journal.count):
            yield _step(_STEP.validate_python(unpacker.unpack()), journal.channels, journal.first_step + offset)
    except (ValueError, IndexError, RecursionError, msgpack.UnpackException) as error:
        reason = "a value of a wrong type" if isinstance(error, ValidationError) else type(error).__name__
        raise JournalError(f"the journal is damaged near step {journal.first_step}: {reason}") from error


def _step(packed: _Step, names: tuple[str, ...], number: int) -> JournaledStep:
    now_ns, states, taken, reads_ns, calls, late, outputs = packed
    return JournaledStep(
        number=number,
        now_ns=now_ns,
        states=tuple(Seen(names[index], crc, receipt_ns) for index, crc, receipt_ns in states),
        taken=tuple(Taken(names[index], answer, payload, at_ns) for index, answer, payload, at_ns in taken),
        reads_ns=tuple(reads_ns),
        calls=tuple((names[index], form, result) for index, form, result in calls),
        late={names[index]: count for index, count in late},
        outputs=tuple(
            Sent(names[index], 0, 0, 0, value) if isinstance(value, bytes) else Sent(names[index], *value, None)
            for index, value in outputs
        ),
    )
