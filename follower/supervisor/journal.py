"""Reports of attempts on disk, written by a thread: a full disk never stops control, only the next start."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from common.files.writer import BackgroundWriter
from common.timing import NS_PER_S

ATTEMPTS_FILE, ATTEMPT_SCHEMA = "attempts.jsonl", "attempt/1"
_PROBE_FILE = ".writable"
_PROBE = "x" * 16_384
_PROBE_PERIOD_NS = 2 * NS_PER_S


class Journal:
    """One JSON line per attempt in ``attempts.jsonl``. While writing fails it is retried every 2 s."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._writer = BackgroundWriter()
        self._probed_ns: int | None = None

    def keep(self, record: dict[str, Any] | None) -> None:
        """Append a record; None: nothing to append."""
        if record is not None:
            self._writer.append_line(self._folder / ATTEMPTS_FILE, json.dumps(record, ensure_ascii=False))

    def unfit(self, now_ns: int) -> str:
        """Why no new docking may begin; empty while the last write succeeded."""
        due = self._probed_ns is None or (self._writer.fault and now_ns - self._probed_ns > _PROBE_PERIOD_NS)
        if due:
            self._probed_ns = now_ns
            self._writer.replace(self._folder / _PROBE_FILE, _PROBE)
        return f"reports cannot be written: {self._writer.fault}" if self._writer.fault else ""

    def close(self) -> None:
        """Write what is still queued."""
        self._writer.close()
