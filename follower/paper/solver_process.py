"""A CasADi solver in a process of its own, so that every solve ends.

Limits on iterations do not bound a solve: fatrop can loop within one iteration, in its restoration phase, on numbers
that diverge, and calls nothing back meanwhile. So the solver runs in a child, which the kernel ends when a solve
takes too long (:mod:`follower.paper.solver_child`); the next solve has a new one.
"""

from __future__ import annotations

import os
import pickle
import select
import signal
import subprocess
import sys
import weakref
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca

from common.errors import DeviceError
from common.geometry import Array

START_S = 60.0  # imports and one deserialisation, on a busy computer
_CHILD = Path(__file__).with_name("solver_child.py")
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


class SolveTooLongError(Exception):
    """A solve was ended at its limit, or the process that replaces an ended one is not ready yet."""


class SolverLostError(Exception):
    """The solver broke off, or took its process down with it."""


@dataclass(frozen=True)
class Solution:
    """What a solver said.

    Attributes:
        values: arrays by CasADi's names: ``x``, ``f``, ``g``, ``lam_x``, ``lam_g``.
        stats: ``success``, ``return_status``, ``iter_count``.
    """

    values: dict[str, Array]
    stats: dict[str, Any]


class SolverProcess:
    """Calls one solver with a limit of wall time. Not for several threads at once.

    Args:
        solver: from ``casadi.nlpsol``.
        limit_s: of a solve, the first one of a process may take a second longer. A process that replaces another
            one and is not ready after it makes a solve fail, too.
    """

    def __init__(self, solver: ca.Function, limit_s: float) -> None:
        self._limit_s = limit_s
        self._stored = os.memfd_create("solver", 0)
        os.pwrite(self._stored, solver.serialize().encode(), 0)
        self._child: subprocess.Popen[bytes] | None = None
        self._ready, self._owner = False, os.getpid()
        self._close_file = weakref.finalize(self, os.close, self._stored)

    def start(self) -> None:
        """Have a process that is ready.

        Raises:
            DeviceError: it does not get ready.
        """
        if not self._is_ready(START_S):
            raise DeviceError(f"the solver's process is not ready after {START_S:.0f} s")

    def __call__(self, **arguments: Array) -> Solution:
        """Solve, as ``solver(**arguments)``.

        Raises:
            SolveTooLongError: it took longer than the limit and was ended, or has no process yet.
            SolverLostError: it broke off, or its process was lost.
        """
        if not self._is_ready(START_S if self._child is None else self._limit_s):
            raise SolveTooLongError
        child = self._child
        assert child is not None
        assert child.stdin is not None
        assert child.stdout is not None
        try:
            pickle.dump(arguments, child.stdin)
            child.stdin.flush()
            answer = pickle.load(child.stdout)
        except (OSError, EOFError, pickle.UnpicklingError) as error:
            late = child.wait() == -signal.SIGALRM
            self._start()  # at once, so that it is ready when it is needed
            raise SolveTooLongError if late else SolverLostError from error
        if answer is None:
            raise SolverLostError
        return Solution(*answer)

    def _is_ready(self, within_s: float) -> bool:
        if self._child is None or self._owner != os.getpid():  # a fork shares no process with its parent
            self._start()
        child = self._child
        assert child is not None
        assert child.stdout is not None
        if not self._ready and select.select([child.stdout], [], [], within_s)[0]:
            try:
                self._ready = pickle.load(child.stdout) == "ready"
            except (EOFError, pickle.UnpicklingError):  # it ended before it was ready
                self._child = None
        return self._ready

    def _start(self) -> None:
        self._ready, self._owner = False, os.getpid()
        child = self._child = subprocess.Popen(
            [sys.executable, "-P", str(_CHILD), str(self._stored), str(self._limit_s)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            pass_fds=(self._stored,),
            env={**os.environ, **dict.fromkeys(_THREADS, "1")},
        )
        weakref.finalize(self, _end, child, self._owner)


def _end(child: subprocess.Popen[bytes], owner: int) -> None:
    if owner != os.getpid():
        return
    child.kill()
    child.wait()
    for stream in (child.stdin, child.stdout):
        if stream is not None:
            try:
                stream.close()
            except OSError:  # what was left unsent to a process that is gone
                continue
