"""A branch of a run: the whole simulation is copied by ``os.fork()``, goes its own way, and reports over a pipe."""

from __future__ import annotations

import os
import pickle
import traceback
from collections.abc import Callable
from typing import TypeVar

Result = TypeVar("Result")


class BranchError(RuntimeError):
    """A branch ended with an exception of the experiment itself, or not at all; the text is its traceback."""


def branch(work: Callable[[], Result]) -> Result:
    """``work()`` in a copy of this process; what it changes stays in the copy.

    The caller must run no thread that holds a lock which ``work`` needs, and share no writable memory.

    Raises:
        BranchError: ``work`` raised, or its process died.
    """
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reading)
        _answer(work, writing)
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        answer = pipe.read()
    _, status = os.waitpid(child, 0)
    if not answer:
        raise BranchError(f"a branch ended without a result, with status {os.waitstatus_to_exitcode(status)}")
    good, content = pickle.loads(answer)
    if not good:
        raise BranchError(content)
    result: Result = content
    return result


def _answer(work: Callable[[], Result], writing: int) -> None:
    """In the child: write the result, and end without what the parent registered for its own end."""
    try:
        try:
            answer = pickle.dumps((True, work()))
        except BaseException:  # noqa: BLE001 - whatever it was, the parent has to know
            answer = pickle.dumps((False, traceback.format_exc()))
        with os.fdopen(writing, "wb") as pipe:
            pipe.write(answer)
    finally:
        os._exit(0)  # also if the parent is gone: a branch never goes on as its parent
