"""The journal of a node's steps: when it stepped, what it consumed, which times and devices it read, what it sent.

An observer on the bus cannot see in which order a node saw its messages. A step is packed once it is complete, so
that the cost is spread evenly; batches leave twice a second.
"""

from __future__ import annotations

import zlib
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from threading import get_ident
from typing import Any

import msgpack

from common.channels import Channel
from common.messages import Answer, Message, StepJournal, encode
from common.messages.records import MOST_RECORD_BYTES
from common.node import Received
from common.recording.devices import DeviceProxy, packed_result
from common.timing import Clock

_BATCH_BYTES = MOST_RECORD_BYTES - 256


@dataclass
class OpenStep:
    """A step that is under way, or whose outputs have not all been sent yet."""

    now_ns: int
    states: list[tuple[str, bytes, int]] = field(default_factory=list)
    taken: list[tuple[str, Received[Any]]] = field(default_factory=list)
    reads_ns: list[int] = field(default_factory=list)
    calls: list[tuple[str, Any, Any]] = field(default_factory=list)
    late: dict[str, int] = field(default_factory=dict)
    outputs: list[tuple[str, Any]] = field(default_factory=list)
    pending: int = 1


class JournalWriter:
    """Keeps the steps of one run of a node. Executors call it; devices and clock reads report to it.

    Calls come from the thread that steps the node; what other threads read is not journaled.
    """

    def __init__(self) -> None:
        self._indices: dict[str, int] = {}
        self._open: OpenStep | None = None
        self._unsettled: deque[OpenStep] = deque()
        self._between: list[tuple[str, Any, Any]] = []
        self._packed: list[bytes] = []
        self._bytes = 0
        self._batches: list[StepJournal] = []
        self._late: dict[str, int] = {}
        self._thread: int | None = None
        self._inside = False
        self._first = 0
        self.steps = 0
        self.lost = 0

    # --- what the executor reports

    def begin(self, now_ns: int) -> OpenStep:
        """A step begins."""
        self._thread = get_ident()
        step = OpenStep(now_ns, calls=self._between)
        self._between = []
        self._open = step
        self._unsettled.append(step)
        self.steps += 1
        return step

    def end(self, step: OpenStep, outputs: int) -> None:
        """The step has returned, with so many outputs that are yet to be sent."""
        self._open = None
        step.pending += outputs - 1
        self._settle()

    def sent(
        self, step: OpenStep, channel: Channel[Any], message: Message, payload: bytes, stamp: int, number: int
    ) -> None:
        """One of the step's outputs has left.

        Args:
            step: that made it.
            channel: on which it left.
            message: itself.
            payload: its bytes.
            stamp: of its header [ns].
            number: its sequence on the channel.
        """
        crosses_bus = channel.kind == "state" and not isinstance(message, Answer)
        step.outputs.append((channel.key, (number, stamp, zlib.crc32(payload)) if crosses_bus else payload))
        step.pending -= 1
        self._settle()

    # --- what inbox, clock and devices report

    def states(self, arrived: Mapping[str, tuple[bytes, int]], late: Mapping[str, int]) -> None:
        """The states that this step sees for the first time, and how many came late on each channel so far."""
        if self._open is None:
            return
        self._open.states = [(key, payload, receipt_ns) for key, (payload, receipt_ns) in arrived.items()]
        changed = {key: count for key, count in late.items() if self._late.get(key) != count}
        if changed:
            self._late.update(changed)
            self._open.late = changed

    def taken(self, key: str, received: Sequence[Received[Any]]) -> None:
        """Requests or answers that this step took."""
        if self._open is not None:
            self._open.taken += [(key, each) for each in received]

    def read(self, now_ns: int) -> int:
        """The clock was read within a step; returns the time."""
        if self._open is not None and not self._inside and get_ident() == self._thread:
            self._open.reads_ns.append(now_ns)
        return now_ns

    def inside(self, entered: bool) -> None:
        """A device works, or has returned: the clock that it reads is not the node's."""
        if get_ident() == self._thread:
            self._inside = entered

    def called(self, name: str, kind: Any, result: Any) -> None:
        """A device returned or raised ``result``, within a step or before one."""
        if self._thread is None or get_ident() == self._thread:
            (self._between if self._open is None else self._open.calls).append((name, kind, result))

    # --- what goes into the node's context, and what leaves

    def clock(self, clock: Clock) -> JournaledClock:
        """The clock for the node's context."""
        return JournaledClock(clock, self)

    def device(self, name: str, device: Any) -> Any:
        """The device for the node: it behaves the same, and its results are journaled."""
        return DeviceProxy(name, device, self)

    def batches(self) -> list[StepJournal]:
        """What has been packed since the last call."""
        self._close_batch()
        batches, self._batches = self._batches, []
        return batches

    def _settle(self) -> None:
        while self._unsettled and self._unsettled[0].pending == 0:
            packed = self._pack(self._unsettled.popleft())
            if len(packed) > _BATCH_BYTES:
                self._close_batch()
                self._first += 1
                self.lost += 1
                continue
            if self._bytes + len(packed) > _BATCH_BYTES:
                self._close_batch()
            self._packed.append(packed)
            self._bytes += len(packed)

    def _close_batch(self) -> None:
        if not self._packed:
            return
        names, count = tuple(self._indices), len(self._packed)
        self._batches.append(StepJournal(self._first, count, names, b"".join(self._packed), self.lost))
        self._first += count
        self._packed, self._bytes = [], 0

    def _pack(self, step: OpenStep) -> bytes:
        index = self._index
        states = [(index(key), zlib.crc32(payload), receipt_ns) for key, payload, receipt_ns in step.states]
        taken = [
            (index(key), isinstance(each.message, Answer), encode(each.message, each.header), each.receipt_ns)
            for key, each in step.taken
        ]
        calls = [(index(name), *packed_result(kind, result)) for name, kind, result in step.calls]
        late = [(index(key), count) for key, count in step.late.items()]
        outputs = [(index(key), value) for key, value in step.outputs]
        packed: bytes = msgpack.packb((step.now_ns, states, taken, step.reads_ns, calls, late, outputs))
        return packed

    def _index(self, name: str) -> int:
        return self._indices.setdefault(name, len(self._indices))


class JournaledClock:
    """A clock whose readings within a step are journaled."""

    def __init__(self, clock: Clock, journal: JournalWriter) -> None:
        self._clock, self._journal = clock, journal

    @property
    def boot_id(self) -> str:
        """As of the clock."""
        return self._clock.boot_id

    def now_ns(self) -> int:
        """As of the clock."""
        return self._journal.read(self._clock.now_ns())
