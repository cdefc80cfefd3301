"""The way of each image to the CAN bus, by its number: exposure → frame → state → command → CAN frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from common.channels import COMMAND, DOCKING_STATE, DRIVES, FRAME, Channel
from common.recording.recording import Recording
from common.timing import NS_PER_MS

HOPS = ("exposure → frame", "frame → state", "state → command", "command → CAN", "image → CAN")


@dataclass(frozen=True)
class Passage:
    """When one image, taken at ``capture_ns``, was published as each of these; None: it never was."""

    capture_ns: int
    frame_ns: int | None
    state_ns: int | None
    command_ns: int | None
    can_ns: int | None


class LatencyTrace:
    """Follows images through the messages of a run; ``take`` each as it comes."""

    CHANNELS: ClassVar[tuple[Channel[Any], ...]] = (FRAME, DOCKING_STATE, COMMAND, DRIVES)

    def __init__(self) -> None:
        self._frames: dict[int, int] = {}
        self._states: dict[int, int] = {}
        self._commands: dict[int, tuple[int, int, int]] = {}
        self._sent: dict[int, int] = {}
        self._sequence = 0

    def take(self, key: str, stamp_ns: int, message: Any) -> None:
        """Take one message of :attr:`CHANNELS`.

        Args:
            key: of its channel.
            stamp_ns: of its header.
            message: itself.
        """
        if key == FRAME.key:
            self._frames[message.sequence] = stamp_ns
        elif key == DOCKING_STATE.key:
            self._states.setdefault(message.frame_sequence, stamp_ns)
        elif key == COMMAND.key:
            self._commands[message.sequence] = (message.frame_sequence, message.capture_ns, stamp_ns)
        elif key == DRIVES.key and message.command_sequence != self._sequence:
            self._sequence = message.command_sequence
            if message.image_to_can_ns:
                self._sent[message.command_sequence] = message.image_to_can_ns

    def passages(self) -> list[Passage]:
        """Every image from which a command was made, in the order of the commands."""
        return [
            Passage(
                capture_ns,
                self._frames.get(frame),
                self._states.get(frame),
                stamp_ns,
                capture_ns + self._sent[sequence] if sequence in self._sent else None,
            )
            for sequence, (frame, capture_ns, stamp_ns) in sorted(self._commands.items())
            if frame in self._frames
        ]

    def hops_ms(self) -> dict[str, list[float]]:
        """Durations of each hop [ms]."""
        found: dict[str, list[float]] = {name: [] for name in HOPS}
        for p in self.passages():
            stations = (p.capture_ns, p.frame_ns, p.state_ns, p.command_ns, p.can_ns)
            for name, begin, end in zip(HOPS, stations, stations[1:], strict=False):
                if begin is not None and end is not None:
                    found[name].append((end - begin) / NS_PER_MS)
            if p.can_ns is not None:
                found[HOPS[-1]].append((p.can_ns - p.capture_ns) / NS_PER_MS)
        return found


def of_recording(recording: Recording) -> LatencyTrace:
    """The trace of a whole file."""
    trace = LatencyTrace()
    for channel in LatencyTrace.CHANNELS:
        for _, header, message in recording.messages(channel):
            trace.take(channel.key, header.stamp_ns, message)
    return trace


def as_table(hops_ms: dict[str, Sequence[float]] | dict[str, list[float]]) -> str:
    """A Markdown table of p50, p99 and the largest."""
    lines = ["| hop | images | p50 ms | p99 ms | max ms |", "|---|---|---|---|---|"]
    for name, values in hops_ms.items():
        if values:
            p50, p99 = np.percentile(values, (50, 99))
            lines.append(f"| {name} | {len(values)} | {p50:.2f} | {p99:.2f} | {max(values):.2f} |")
        else:
            lines.append(f"| {name} | 0 | – | – | – |")
    return "\n".join(lines)
