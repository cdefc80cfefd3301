"""The files of one recording on disk: made, flushed to the disk itself, completed."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any

from common.channels import Channel
from common.config import Config
from common.recording.run import Item, RunRecording, frames_path


class RecordingFiles:
    """A :class:`.live.Sink` that writes everything into one recording.

    Args:
        path: of the signals; the frames lie beside it.
        config: of the run.
        about: what else is to be known of the run.
        lossless: whether there are frames to be kept.
        views: whether what viewers show is written at once.
        further: channels outside the table whose messages are shown too.

    Raises:
        OSError: they cannot be made.
    """

    def __init__(
        self,
        path: Path,
        config: Config,
        about: dict[str, str],
        *,
        lossless: bool,
        views: bool,
        further: Sequence[Channel[Any]] = (),
    ) -> None:
        self._stack = ExitStack()
        self._files: list[IO[bytes]] = [self._stack.enter_context(path.open("wb"))]
        if lossless:
            self._files.append(self._stack.enter_context(frames_path(path).open("wb")))
        self._kept = RunRecording(
            self._files[0],
            config,
            about,
            views=views,
            frames=self._files[1] if lossless else None,
            frames_bytes=config.recorder.frames_mb * 1_000_000,
            further=further,
        )

    @property
    def size_bytes(self) -> int:
        """Bytes in the files so far."""
        return self._kept.size_bytes

    def take(self, item: Item) -> None:
        """Append one item."""
        self._kept.add(item)

    def drop(self, key: str, count: int) -> None:
        """Note that messages are missing."""
        self._kept.drop(key, count)

    def flush(self) -> None:
        """To the disk: neither a crash nor a power cut loses what was taken until now."""
        self._kept.flush()
        for file in self._files:
            os.fdatasync(file.fileno())

    def close(self) -> None:
        """Complete and close the files."""
        with self._stack:
            self._kept.close()
