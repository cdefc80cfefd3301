"""Which part of the stream becomes a file: each docking, with some seconds before and after it.

A :class:`common.recording.live.Sink`. A file is named after its docking when that has ended; until then, and after a
crash, its name ends in ``.part.mcap``.
"""

from __future__ import annotations

import logging
import re
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Protocol

from common.causes import cause_code
from common.channels import MISSION
from common.config import RecorderConfig
from common.messages import MessageError, Mission, decode
from common.recording.run import Item, frames_path
from common.timing import NS_PER_S
from follower.recorder.retention import superfluous

PART = ".part.mcap"
_MOST_BEFORE_BYTES = 320_000_000
_BETWEEN = ("idle", "done", "aborted", "manual")
_log = logging.getLogger("follower-recorder")


class OpenFiles(Protocol):
    """The files of one recording, see :class:`common.recording.files.RecordingFiles`."""

    @property
    def size_bytes(self) -> int:
        """Bytes in the files."""

    def take(self, item: Item) -> None:
        """Append one item."""

    def drop(self, key: str, count: int) -> None:
        """Note that messages are missing."""

    def flush(self) -> None:
        """To the disk."""

    def close(self) -> None:
        """Complete the files."""


Opener = Callable[[Path], OpenFiles]


class AttemptFiles:
    """Keeps the last seconds in memory; begins a file with them when a docking begins.

    Args:
        folder: of the files; made as needed.
        config: what to keep.
        opener: begins the files of a recording.
        stamp: names the time of day, for file names.
    """

    def __init__(self, folder: Path, config: RecorderConfig, opener: Opener, stamp: Callable[[], str]) -> None:
        self._folder, self._config, self._opener, self._stamp = folder, config, opener, stamp
        self._before: deque[Item] = deque()
        self._before_bytes = 0
        self._files: OpenFiles | None = None
        self._path = Path()
        self._mission: Mission | None = None
        self._begun_ns = 0
        self._ends_ns: int | None = None
        self._lost: dict[str, int] = {}
        self._retry_ns = 0

    @property
    def recording(self) -> bool:
        """Whether a file is open."""
        return self._files is not None

    def take(self, item: Item) -> None:
        """Take the next item, and begin or end a file where a docking does."""
        docking = self._docking(item)
        if self._files is None:
            self._keep(item)
            if not docking:
                self._retry_ns = 0
            elif item.receipt_ns >= self._retry_ns:
                self._begin(item.receipt_ns)
            return
        self._write(lambda files: files.take(item))
        self._mark_end(docking, item.receipt_ns)

    def drop(self, key: str, count: int) -> None:
        """Messages are missing from here on."""
        self._lost[key] = self._lost.get(key, 0) + count
        self._write(lambda files: files.drop(key, count))

    def flush(self) -> None:
        """To the disk."""
        self._write(lambda files: files.flush())

    def close(self) -> None:
        """End the file that is open."""
        if self._files is not None:
            self._finish("stopped")

    def _docking(self, item: Item) -> bool:
        if item.key == MISSION.key:
            try:
                self._mission = decode(Mission, item.payload)[1]
            except MessageError:
                return False
        return self._mission is not None and self._mission.phase not in _BETWEEN

    def _keep(self, item: Item) -> None:
        """Keep the item for a docking that may begin."""
        self._before.append(item)
        self._before_bytes += _bytes(item)
        oldest_ns = item.receipt_ns - round(self._config.before_s * NS_PER_S)
        while self._before and (self._before[0].receipt_ns < oldest_ns or self._before_bytes > _MOST_BEFORE_BYTES):
            self._before_bytes -= _bytes(self._before.popleft())

    def _begin(self, now_ns: int) -> None:
        trolley = self._mission.trolley if self._mission is not None else 0
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            for path in superfluous(self._folder, self._config.disk_mb * 1_000_000):
                path.unlink(missing_ok=True)
                frames_path(path).unlink(missing_ok=True)
            self._path = self._folder / f"{self._stamp()}-K{trolley}{PART}"
            self._files = self._opener(self._path)
        except OSError as error:
            self._retry_ns = now_ns + NS_PER_S
            _log.warning("this docking is not recorded: %s: %s", error.filename or self._folder, error.strerror)
            return
        self._begun_ns, self._ends_ns = now_ns, None
        before, self._before, self._before_bytes = self._before, deque(), 0
        for key, count in self._lost.items():
            self._write(lambda files, key=key, count=count: files.drop(key, count))  # type: ignore[misc]
        self._lost = {}
        for item in before:
            self._write(lambda files, item=item: files.take(item))  # type: ignore[misc]

    def _mark_end(self, docking: bool, now_ns: int) -> None:
        if docking:
            self._ends_ns = None
        elif self._ends_ns is None:
            self._ends_ns = now_ns + round(self._config.after_s * NS_PER_S)
        if self._files is None:
            return
        too_long = (
            now_ns - self._begun_ns > self._config.longest_s * NS_PER_S
            or self._files.size_bytes > (self._config.disk_mb + self._config.frames_mb) * 1_000_000
        )
        if too_long or (self._ends_ns is not None and now_ns >= self._ends_ns):
            self._finish("too_long" if too_long else self._outcome())

    def _outcome(self) -> str:
        mission = self._mission
        if mission is None or mission.phase == "done":
            return "docked"
        return re.sub(r"[^a-z_]", "", cause_code(mission.cause)) or "ended"

    def _finish(self, outcome: str) -> None:
        files, self._files = self._files, None
        if files is None:
            return
        try:
            files.close()
            named = self._path.with_name(self._path.name.replace(PART, f"-{outcome}.mcap"))
            if frames_path(self._path).exists():
                frames_path(self._path).rename(frames_path(named))
            self._path.rename(named)
            _log.info("recorded %s", named)
        except OSError as error:
            _log.warning("%s: %s", error.filename or self._path, error.strerror)

    def _write(self, work: Callable[[OpenFiles], None]) -> None:
        """A full disk ends the file; what is in it stays."""
        if self._files is None:
            return
        try:
            work(self._files)
        except OSError as error:
            _log.warning("%s: %s: the recording ends here", error.filename or self._path, error.strerror)
            files, self._files, self._retry_ns = self._files, None, 2**63 - 1
            with suppress(OSError):
                files.close()


def _bytes(item: Item) -> int:
    return len(item.payload) + len(item.picture or b"") + len(item.pixels or b"")
