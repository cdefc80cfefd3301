"""Recording beside what must not wait: a bounded queue, and one thread that packs pictures and writes files."""

from __future__ import annotations

import threading
import time
from collections import Counter, deque
from typing import Protocol

from common.recording.run import FramePictures, Item

FLUSH_S, LOOK_S = 0.5, 0.02
# so much waits at most; frames wait in shared memory for 100 ms, which is sooner
_MOST_BYTES, _MOST_ITEMS = 32_000_000, 20_000


class Sink(Protocol):
    """What the thread calls. None of it is called twice at once."""

    def take(self, item: Item) -> None:
        """The next item."""

    def drop(self, key: str, count: int) -> None:
        """So many messages of a channel were dropped before the next item."""

    def flush(self) -> None:
        """Twice a second, and at the end."""

    def close(self) -> None:
        """At the end."""


class LiveRecording:
    """Hands everything to a sink from a thread of its own; when too much waits the oldest is dropped and counted.

    Args:
        sink: writes.
        pictures: packs frames.
        name: of the thread.
    """

    def __init__(self, sink: Sink, pictures: FramePictures, name: str = "recording") -> None:
        self._sink, self._pictures = sink, pictures
        self._waiting: deque[tuple[str, bytes, int]] = deque()
        self._bytes = 0
        self._dropped: Counter[str] = Counter()
        self._change = threading.Condition()
        self._closing = False
        self.dropped = 0
        self.fault = ""
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def put(self, key: str, payload: bytes, receipt_ns: int) -> None:
        """Take a message; returns at once."""
        with self._change:
            self._waiting.append((key, payload, receipt_ns))
            self._bytes += len(payload)
            while self._bytes > _MOST_BYTES or len(self._waiting) > _MOST_ITEMS:
                oldest = self._waiting.popleft()
                self._bytes -= len(oldest[1])
                self._dropped[oldest[0]] += 1
                self.dropped += 1

    def close(self, timeout_s: float = 5.0) -> None:
        """Write what waits, for at most ``timeout_s``."""
        with self._change:
            self._closing = True
            self._change.notify()
        self._thread.join(timeout_s)

    def _run(self) -> None:
        due_s = time.monotonic() + FLUSH_S
        while True:
            with self._change:
                self._change.wait_for(lambda: self._closing, LOOK_S)  # to be woken by each message would cost more
                waiting, dropped, closing = self._waiting, self._dropped, self._closing
                self._waiting, self._bytes, self._dropped = deque(), 0, Counter()
            try:
                self._write(waiting, dropped)
                if time.monotonic() >= due_s or closing:
                    due_s = time.monotonic() + FLUSH_S
                    self._sink.flush()
                if closing:
                    self._sink.close()
                self.fault = ""
            except OSError as error:
                self.fault = f"{error.filename or 'recording'}: {error.strerror}"
            if closing:
                return

    def _write(self, waiting: deque[tuple[str, bytes, int]], dropped: Counter[str]) -> None:
        for key, count in dropped.items():
            self._sink.drop(key, count)
        for message in waiting:
            self._sink.take(self._pictures.item(*message))
