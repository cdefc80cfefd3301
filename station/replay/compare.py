"""Replayed outputs against recorded ones: to the bit, and the first difference by field."""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from common.channels import Channel
from common.config import Config
from common.errors import ConfigError
from common.messages import Answer, Header, Message, MessageError, decode, encode
from common.recording.recording import Recording
from common.recording.steps import Sent
from station.replay.core import ReplayedNode, Segment, Step, longest_run, missing_inputs, replayed, segments
from station.replay.recorded_devices import DivergedError

_SHOWN = 12


@dataclass(frozen=True)
class Difference:
    """What differs first between a recorded and a replayed step."""

    step: int
    time_ns: int
    what: str
    recorded: Any
    replayed: Any

    def __str__(self) -> str:
        return (
            f"step {self.step} at {self.time_ns} ns: {self.what}: recorded {self.recorded!r}, now {self.replayed!r}"
        )


@dataclass
class ReplayVerdict:
    """What a replay of one core came to; ``skipped`` steps cannot be replayed, for an input or a state is missing."""

    core: str
    steps: int = 0
    skipped: int = 0
    segments: int = 0
    outputs: int = 0
    equal: int = 0
    first: Difference | None = None
    fields: dict[str, tuple[int, float]] = field(default_factory=dict)
    stopped: str = ""

    @property
    def identical(self) -> bool:
        """Every output of every step that can be replayed, to the bit."""
        return self.first is None and not self.stopped and self.outputs == self.equal and self.steps > 0

    def summary(self) -> list[str]:
        """Lines for people."""
        if not self.steps and not self.stopped:
            lines = [f"{self.core}: no step can be replayed"]
        elif self.identical:
            lines = [f"{self.core}: bit-identical: {self.outputs} outputs of {self.steps} steps"]
        else:
            lines = [f"{self.core}: {self.equal} of {self.outputs} outputs of {self.steps} steps are identical"]
        if self.first is not None:
            lines.append(f"  first difference: {self.first}")
        if self.stopped:
            lines.append(f"  stopped: {self.stopped}")
        if self.skipped:
            lines.append(
                f"  {self.skipped} steps cannot be replayed: the file lacks an input, or the state before it"
            )
        for name, (count, most) in sorted(self.fields.items(), key=lambda item: -item[1][0])[:_SHOWN]:
            size = "" if math.isnan(most) else f", at most by {most:.3g}"
            lines.append(f"  {name}: {count} times{size}")
        return lines


def judge(
    core: str, recording: Recording, config: Config, config_path: Path, *, fresh: bool = False
) -> ReplayVerdict:
    """Replay the longest run of a core and compare every output.

    Args:
        core: its name.
        recording: with the run.
        config: with which to replay it.
        config_path: beside which the files lie that it names.
        fresh: begin as after a start, not with the recorded state; only for a run that began within the recording.

    Raises:
        ConfigError: no journal of it; or ``fresh``, and its start is not recorded.
    """
    run = longest_run(recording, core)
    verdict = ReplayVerdict(core)
    found = [Segment(run.steps, None)] if fresh else segments(recording, run)
    if fresh and (run.steps[0].number != 0 or any(missing_inputs(recording, step) for step in run.steps)):
        raise ConfigError(f"{recording.path}: {run.process}: its start or some input is not recorded")
    verdict.skipped = len(run.steps) - sum(len(segment.steps) for segment in found)
    verdict.segments = len(found)
    for segment in found:
        with replayed(recording, run, config, config_path, segment) as node:
            comparison = _Comparison(verdict, recording, node)
            try:
                for step in node.replay():
                    comparison.step(step)
            except DivergedError as error:
                verdict.stopped = verdict.stopped or str(error)
    return verdict


class _Comparison:
    def __init__(self, verdict: ReplayVerdict, recording: Recording, node: ReplayedNode) -> None:
        self._verdict, self._node = verdict, node
        self._recorded: dict[str, dict[tuple[int, int], bytes]] = {}
        self._recording = recording

    def step(self, step: Step) -> None:
        verdict = self._verdict
        verdict.steps += 1
        expected, got = step.recorded.outputs, step.outputs
        verdict.outputs += max(len(expected), len(got))
        keys = [sent.key for sent in expected], [channel.key for channel, _ in got]
        if keys[0] != keys[1]:
            self._differs(step, "channels of its outputs", keys[0], keys[1])
            return
        for sent, (channel, message) in zip(expected, got, strict=True):
            if self._bytes(sent, message) == (sent.crc if sent.payload is None else sent.payload):
                verdict.equal += 1
            else:
                self._explain(step, sent, channel, message)

    def _bytes(self, sent: Sent, message: Message) -> int | bytes:
        """CRC-32 of the message as it would have been sent; itself where the journal holds it whole."""
        run = self._node.run
        if sent.payload is None:
            header = Header(run.process, run.run_id, sent.sequence, sent.stamp_ns, run.boot_id)
            return zlib.crc32(encode(message, header))
        then = _header(sent.payload, message)
        return b"" if then is None else encode(message, then)

    def _explain(self, step: Step, sent: Sent, channel: Channel[Any], message: Message) -> None:
        payload = sent.payload if sent.payload is not None else self._published(channel.key, sent)
        recorded = None if payload is None else _decoded(payload, message)
        if recorded is None:
            self._differs(step, f"{channel.key} (the recorded message is not in the file)", "?", message)
            return
        found = False
        for name, before, after in differing(asdict(recorded), asdict(message)):  # type: ignore[call-overload]
            found = True
            place = f"{channel.key}: {name}"
            self._differs(step, place, before, after)
            count, most = self._verdict.fields.get(place, (0, math.nan))
            numbers = isinstance(before, int | float) and isinstance(after, int | float)
            size = abs(after - before) if numbers else math.nan
            self._verdict.fields[place] = count + 1, size if math.isnan(most) else max(most, size)
        if not found:
            self._differs(step, f"{channel.key}: type or sign of a number", recorded, message)

    def _differs(self, step: Step, what: str, before: Any, after: Any) -> None:
        if self._verdict.first is None:
            self._verdict.first = Difference(step.recorded.number, step.recorded.now_ns, what, before, after)

    def _published(self, key: str, sent: Sent) -> bytes | None:
        if key not in self._recorded:
            index: dict[tuple[int, int], bytes] = {}
            for record in self._recording.topics.get(key, ()):
                index[record.publish_ns, zlib.crc32(record.data)] = record.data
            self._recorded[key] = index
        return self._recorded[key].get((sent.stamp_ns, sent.crc))


def _header(payload: bytes, message: Message) -> Header | None:
    try:
        return decode(type(message), payload)[0]
    except MessageError:
        return None


def _decoded(payload: bytes, message: Message) -> Message | None:
    try:
        return decode(Answer if isinstance(message, Answer) else type(message), payload)[1]
    except MessageError:
        return None


def differing(before: Any, after: Any, name: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Fields that differ between two plain values, by name and index, as (name, before, after)."""
    if isinstance(before, dict) and isinstance(after, dict) and before.keys() == after.keys():
        for key in before:
            yield from differing(before[key], after[key], f"{name}.{key}" if name else key)
    elif isinstance(before, tuple | list) and isinstance(after, tuple | list) and len(before) == len(after):
        for index, (one, other) in enumerate(zip(before, after, strict=True)):
            yield from differing(one, other, f"{name}[{index}]")
    elif before != after:
        yield name, before, after
