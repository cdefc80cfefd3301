"""Recorder process: overhears everything, and keeps each docking in a file of its own."""

from __future__ import annotations

import logging
import platform
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from common.files.writer import state_directory
from common.node import Inbox, Node, NodeContext, Output, Trigger
from common.recording.files import RecordingFiles
from common.recording.live import LiveRecording
from common.recording.run import FramePictures
from common.timing import NS_PER_S
from follower.recorder.attempts import AttemptFiles

FOLDER = "recordings"
_log = logging.getLogger("follower-recorder")


class RecorderNode(Node):
    """Hands everything to a thread; control never waits for it."""

    name = "follower-recorder"
    overhears = True
    trigger = Trigger(period_ns=NS_PER_S)

    def __init__(self, context: NodeContext) -> None:
        self._context, chosen = context, context.config.recorder
        kept = state_directory(context.config.state_directory, context.runtime)
        self.folder = Path(chosen.directory) if chosen.directory else kept / FOLDER
        self._attempts = AttemptFiles(self.folder, chosen, self._opened, _time_of_day)
        self._live: LiveRecording | None = None
        self._dropped, self._fault = 0, ""

    def start(self, now_ns: int) -> None:  # noqa: ARG002 - the contract's signature
        """Begin to take what is overheard."""
        chosen = self._context.config.recorder
        pictures = FramePictures(
            self._context.runtime, chosen.pictures_hz, chosen.picture_quality, lossless=chosen.frames == "all"
        )
        self._live = LiveRecording(self._attempts, pictures)

    def overhear(self, key: str, payload: bytes, receipt_ns: int) -> None:
        """Take it; from the bus's thread."""
        if self._live is not None:
            self._live.put(key, payload, receipt_ns)

    def step(self, now_ns: int, inputs: Inbox) -> Sequence[Output]:  # noqa: ARG002
        """Report what was lost."""
        live = self._live
        if live is None:
            return ()
        if live.dropped != self._dropped:
            _log.warning("%d messages dropped: this computer is too slow", live.dropped - self._dropped)
            self._dropped = live.dropped
        if live.fault != self._fault:
            self._fault = live.fault
            if self._fault:
                _log.warning("%s", self._fault)
        return ()

    def stop(self, now_ns: int) -> Sequence[Output]:  # noqa: ARG002
        """Write what waits, and complete the file."""
        if self._live is not None:
            self._live.close()
        return ()

    def _opened(self, path: Path) -> RecordingFiles:
        context = self._context
        about = {
            "source": self.name,
            "host": platform.node(),
            "began": datetime.now(UTC).isoformat(),
            "monotonic_ns": str(context.clock.now_ns()),
            "boot": context.clock.boot_id,
        }
        chosen = context.config.recorder
        return RecordingFiles(path, context.config, about, lossless=chosen.frames == "all", views=chosen.views)


def _time_of_day() -> str:
    return datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")


def make(context: NodeContext) -> RecorderNode:
    """The recorder process."""
    return RecorderNode(context)
