"""A recording in memory: every message of a file by channel, and the frames of the file beside it."""

from __future__ import annotations

import zlib
from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TypeVar

from common.channels import CHANNELS, Channel, journal_channel, snapshot_channel
from common.config import Config
from common.errors import ConfigError
from common.frames.ring import Image
from common.messages import Header, Message, MessageError, NodeSnapshot, decode
from common.recording import scene
from common.recording.mcap_file import Note, Recorded, TornEnd, read_file
from common.recording.pictures import pixels
from common.recording.run import CONFIGURATION_NOTE, DROPPED_NOTE, RUN_NOTE, frames_path, recorded_config
from common.recording.steps import JournaledStep, JournalError, steps_of

M = TypeVar("M", bound=Message)
_CACHED_FRAMES = 16
STATES = {channel.key: channel for channel in CHANNELS}


@dataclass(frozen=True)
class ProcessRun:
    """One process from its start to its end: its steps in order, and its state before some of them."""

    process: str
    run_id: int
    boot_id: str
    steps: list[JournaledStep]
    snapshots: dict[int, list[NodeSnapshot]]


@dataclass
class Recording:
    """What one file holds. ``torn`` says why it ends too early; empty if it is complete."""

    path: Path
    topics: dict[str, list[Recorded]] = field(default_factory=dict)
    notes: dict[str, dict[str, str]] = field(default_factory=dict)
    torn: str = ""

    @classmethod
    def read(cls, path: Path) -> Recording:
        """Read a whole file.

        Raises:
            ConfigError: there is none, or it is no recording.
        """
        found = cls(path)
        for record in read_file(path):
            match record:
                case Recorded():
                    found.topics.setdefault(record.topic, []).append(record)
                case Note():
                    found.notes[record.name] = record.content
                case TornEnd():
                    found.torn = record.reason
        if RUN_NOTE not in found.notes:
            raise ConfigError(f"{path}: holds no record of davpc")
        return found

    @cached_property
    def config(self) -> Config:
        """The configuration of the run.

        Raises:
            ConfigError: it is none of this version.
        """
        return recorded_config(self.notes.get(CONFIGURATION_NOTE, {}), str(self.path))

    @property
    def about(self) -> dict[str, str]:
        """Versions, seed and what else is known of the run."""
        return self.notes[RUN_NOTE]

    @property
    def dropped(self) -> dict[str, int]:
        """How many messages of each channel are missing."""
        return {name: int(text) for name, text in self.notes.get(DROPPED_NOTE, {}).items() if text.isdecimal()}

    def messages(self, channel: Channel[M]) -> Iterator[tuple[int, Header, M]]:
        """Every valid message of a channel, in the order of receipt, with the time of receipt."""
        for record in self.topics.get(channel.key, ()):
            try:
                header, message = decode(channel.message, record.data)
            except MessageError:
                continue
            yield record.log_ns, header, message

    def payload(self, key: str, crc: int, receipt_ns: int) -> bytes | None:
        """The payload of a channel with this CRC-32; of several the one received nearest to this time."""
        found = self._by_crc.get((key, crc))
        if not found:
            return None
        return min(found, key=lambda record: abs(record.log_ns - receipt_ns)).data

    @cached_property
    def _by_crc(self) -> dict[tuple[str, int], list[Recorded]]:
        index: dict[tuple[str, int], list[Recorded]] = {}
        for key, records in self.topics.items():
            for record in records:
                index.setdefault((key, zlib.crc32(record.data)), []).append(record)
        return index

    def runs(self, process: str) -> list[ProcessRun]:
        """Every run of a process that was journaled.

        Raises:
            ConfigError: its journal is damaged.
        """
        runs: dict[int, ProcessRun] = {}
        try:
            for _, header, journal in self.messages(journal_channel(process)):
                run = runs.setdefault(header.run_id, ProcessRun(process, header.run_id, header.boot_id, [], {}))
                run.steps.extend(steps_of(journal))
        except JournalError as error:
            raise ConfigError(f"{self.path}: {process}: {error}") from error
        for _, header, part in self.messages(snapshot_channel(process)):
            if header.run_id in runs:
                runs[header.run_id].snapshots.setdefault(part.step, []).append(part)
        return list(runs.values())

    @cached_property
    def frames(self) -> RecordedFrames:
        """The frames without loss."""
        return RecordedFrames(frames_path(self.path))


class RecordedFrames:
    """Frames by capture time, read forward from their file as they are asked for."""

    def __init__(self, path: Path) -> None:
        self._records = self._read(path) if path.exists() else iter(())
        self._path = path
        self._recent: OrderedDict[int, bytes] = OrderedDict()

    @property
    def there(self) -> bool:
        """Whether the run kept its frames."""
        return self._path.exists()

    @cached_property
    def times_ns(self) -> frozenset[int]:
        """When each of them was taken."""
        if not self.there:
            return frozenset()
        records = (record for record in read_file(self._path) if isinstance(record, Recorded))
        return frozenset(record.publish_ns for record in records if record.topic == scene.FRAMES)

    def at(self, capture_ns: int) -> Image | None:
        """The frame taken at this time; None if it is not in the file, or was asked for too late."""
        while capture_ns not in self._recent:
            found = next(self._records, None)
            if found is None:
                break
            self._recent[found[0]] = found[1]
            if len(self._recent) > _CACHED_FRAMES:
                self._recent.popitem(last=False)
        data = self._recent.get(capture_ns)
        return None if data is None else pixels(data)

    @staticmethod
    def _read(path: Path) -> Iterator[tuple[int, bytes]]:
        for record in read_file(path):
            if isinstance(record, Recorded) and record.topic == scene.FRAMES:
                yield scene.read_image(record.data)
