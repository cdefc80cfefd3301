"""What a process leaves for a replay: the journal of its steps, and its state before one of them."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field
from pydantic.dataclasses import dataclass

from common.messages.fields import STRICT, Count, Text

MOST_RECORD_BYTES = 60_000
Packed = Annotated[bytes, Field(max_length=MOST_RECORD_BYTES)]


@dataclass(frozen=True, config=STRICT)
class StepJournal:
    """Some steps of a process in a row, packed by :mod:`common.recording.journal`."""

    SCHEMA: ClassVar[str] = "step_journal/1"
    first_step: Count  # number of the first of these steps, counted from 0 since the process's start
    count: Count  # of steps
    channels: Annotated[tuple[Text, ...], Field(max_length=64)]  # that the packed steps refer to by index
    steps: Packed
    lost_steps: Count  # since the start: steps too large to be sent


@dataclass(frozen=True, config=STRICT)
class NodeSnapshot:
    """A part of a node's state before a step, packed by :mod:`common.recording.snapshot`."""

    SCHEMA: ClassVar[str] = "node_snapshot/1"
    step: Count  # number of the step before which it was taken
    part: Annotated[int, Field(ge=0, lt=64)]
    parts: Annotated[int, Field(ge=1, le=64)]
    state: Packed
