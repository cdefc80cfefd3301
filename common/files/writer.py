"""Files: written beside a loop that must not wait, replaced as a whole, as strict JSON; and where state is kept."""

from __future__ import annotations

import json
import math
import os
import threading
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

_ROTATE_BYTES = 8_000_000


class BackgroundWriter:
    """Writes files in order, from a thread; when too many writes wait, the oldest is dropped.

    A full disk or a missing folder stops nothing: ``fault`` names the last failure, until the next write succeeds.
    """

    def __init__(self, limit: int = 64) -> None:
        self._waiting: deque[Callable[[], None]] = deque()
        self._limit = limit
        self._change = threading.Condition()
        self._closing = False
        self._thread: threading.Thread | None = None
        self.fault = ""

    def append_line(self, path: Path, line: str) -> None:
        """Append one line to a file, in a folder made as needed. A file of 8 MB is renamed to ``….old`` first."""
        self._submit(lambda: _append(path, line))

    def replace(self, path: Path, content: str) -> None:
        """Replace a file as a whole: a power cut leaves the old content or the new."""
        self._submit(lambda: replace_file(path, content))

    def close(self, timeout_s: float = 2.0) -> None:
        """Finish the waiting writes, for at most ``timeout_s``."""
        with self._change:
            self._closing = True
            self._change.notify_all()
        if self._thread is not None:
            self._thread.join(timeout_s)

    def _submit(self, work: Callable[[], None]) -> None:
        with self._change:
            if len(self._waiting) >= self._limit:
                self._waiting.popleft()
            self._waiting.append(work)
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="background-writer", daemon=True)
                self._thread.start()
            self._change.notify_all()

    def _run(self) -> None:
        while True:
            with self._change:
                self._change.wait_for(lambda: self._waiting or self._closing)
                if not self._waiting:
                    return
                work = self._waiting.popleft()
            try:
                work()
                self.fault = ""
            except OSError as error:
                self.fault = f"{error.filename or 'state'}: {error.strerror}"
            except UnicodeEncodeError as error:
                self.fault = f"a text that is not Unicode: {error.reason}"


def replace_file(path: Path, content: str) -> None:
    """Write a new file beside it, flush it to disk, rename it over the old one.

    Raises:
        OSError: it cannot be written; the old file is as it was, and ``filename`` names it.
    """
    beside = path.with_name(f".{path.name}.new")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with beside.open("w", encoding="utf-8") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        beside.rename(path)
        _flush_folder(path.parent)
    except OSError as error:
        with suppress(OSError):
            beside.unlink(missing_ok=True)
        raise OSError(error.errno, error.strerror, str(path)) from error


def _append(path: Path, line: str) -> None:
    """Add a line. One that a power cut tore is ended first, so that no more than that one is lost."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.exists() and path.stat().st_size > _ROTATE_BYTES:
        path.rename(path.with_name(f"{path.name}.old"))
    new = not path.exists()
    with path.open("a+b") as file:
        if file.tell() > 0:
            file.seek(-1, os.SEEK_END)
            if file.read(1) != b"\n":
                file.write(b"\n")
        file.write(line.encode("utf-8") + b"\n")
        file.flush()
        os.fsync(file.fileno())
    if new:
        _flush_folder(path.parent)


def _flush_folder(folder: Path) -> None:
    """A new name in a folder is on the disk only once the folder is."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def state_directory(configured: str, runtime: Path) -> Path:
    """Directory for persistent state: as configured, else systemd's STATE_DIRECTORY, else ``runtime``."""
    if configured:
        return Path(configured)
    given = os.environ.get("STATE_DIRECTORY", "").partition(":")[0]
    return Path(given) if given else runtime


def write_json(path: Path, content: dict[str, Any]) -> dict[str, Any]:
    """Write ``content`` as strict JSON, with null for NaN and infinity; returns what a reader of the file gets."""
    text = json.dumps(_json_ready(content), indent=1, ensure_ascii=False, allow_nan=False)
    replace_file(path, text + "\n")
    written: dict[str, Any] = json.loads(text)
    return written


def _json_ready(content: Any) -> Any:
    # one run that never ended must not make the results of the others unreadable
    if isinstance(content, Mapping):
        return {key: _json_ready(value) for key, value in content.items()}
    if isinstance(content, (list, tuple)):
        return [_json_ready(value) for value in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content
