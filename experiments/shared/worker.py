"""A process that does one run after the other, in one thread: a run may fork, and gives the same bits everywhere.

Requests and answers are pickles with their length in front, over stdin and stdout. ``concurrent.futures`` does not
serve here: a worker of dask is a daemonic process, in which multiprocessing refuses to start another, and one lost
process would break its whole pool, with no word of which run was the cause.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import signal
import subprocess
import sys
import threading
import traceback
from typing import IO, cast

from common.errors import DeviceError

TRIES = 3
_LENGTH_BYTES = 8
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
_Child = subprocess.Popen[bytes]


class Children:
    """Processes that do runs, one for each caller at a time; a run whose process is lost is repeated in another."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._idle: list[_Child] = []
        self._busy: set[_Child] = set()
        self._closed = False

    def do(self, request: bytes) -> bytes:
        """Do one run: a pickled pair of function and argument; for the answer see :func:`answer`.

        Raises:
            DeviceError: the process was lost each of three times, or this was closed.
        """
        how = "closed"
        for _ in range(TRIES):
            child = self._take()
            if child is None:
                break
            try:
                assert child.stdin is not None
                assert child.stdout is not None
                _send(child.stdin, request)
                result = _receive(child.stdout)
            except OSError:
                result = None
            if self._put_back(child, usable=result is not None):
                return cast(bytes, result)
            how = f"exit code {child.returncode}"
        raise DeviceError(f"a run lost its process {TRIES} times ({how}): out of memory?")

    def close(self) -> None:
        """End them all, at once; a caller that waits for one gets an error."""
        with self._lock:
            self._closed = True
            idle, self._idle = self._idle, []
            for child in self._busy:
                child.kill()
        for child in idle:
            _end(child)

    def _put_back(self, child: _Child, usable: bool) -> bool:
        """After a run; whether there is an answer: else the process is gone."""
        with self._lock:
            self._busy.discard(child)
            if usable and not self._closed:
                self._idle.append(child)
                return True
        _end(child)
        return usable

    def _take(self) -> _Child | None:
        with self._lock:
            if self._closed:
                return None
            child = self._idle.pop() if self._idle else _start()
            self._busy.add(child)
            return child


def _start() -> _Child:
    child = subprocess.Popen(
        [sys.executable, "-m", "experiments.shared.worker"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env={**os.environ, **dict.fromkeys(_THREADS, "1")},
    )
    assert child.stdin is not None
    _send(child.stdin, pickle.dumps(sys.path))
    return child


def _end(child: _Child) -> None:
    child.kill()
    child.wait()
    for stream in (child.stdin, child.stdout):
        with contextlib.suppress(OSError):
            assert stream is not None
            stream.close()


def answer(request: bytes) -> bytes:
    """What a run gave, pickled: True and its result, or False and its exception with the traceback as a note."""
    work, item = pickle.loads(request)
    try:
        return pickle.dumps((True, work(item)))
    except Exception as error:  # noqa: BLE001 - whatever it was, the caller has to know
        text = traceback.format_exc()
        error.add_note(text)
        try:
            content = pickle.dumps((False, error))
            pickle.loads(content)
        except Exception:  # noqa: BLE001 - an exception of any kind may refuse to be pickled
            return pickle.dumps((False, RuntimeError(text)))
        return content


def _send(stream: IO[bytes], content: bytes) -> None:
    stream.write(len(content).to_bytes(_LENGTH_BYTES, "little") + content)
    stream.flush()


def _receive(stream: IO[bytes]) -> bytes | None:
    """The next content; None at the end of the stream."""
    head = stream.read(_LENGTH_BYTES)
    content = stream.read(int.from_bytes(head, "little"))
    return content if len(head) == _LENGTH_BYTES and len(content) == int.from_bytes(head, "little") else None


def main() -> None:
    """Do runs until the caller is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a Ctrl-C is the caller's, who ends this process
    requests, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a run prints must not get among the answers
    path = _receive(requests)
    if path is not None:
        sys.path[:] = pickle.loads(path)
    while (request := _receive(requests)) is not None:
        _send(answers, answer(request))


if __name__ == "__main__":
    main()
