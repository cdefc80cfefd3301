"""The far side of :mod:`follower.paper.solver_process`: one CasADi solver, one problem after the other.

Before each solve the kernel is asked to end this process when the time is over. No code of the solver has to
cooperate for that, and nothing is left behind that still computes.
"""

from __future__ import annotations

import os
import pickle
import signal
import sys

import casadi as ca
import numpy as np

READY = "ready"
OUTPUTS = ("x", "f", "g", "lam_x", "lam_g")
FIRST_S = 1.0  # besides: the first solve of a process loads and allocates
STATS = ("success", "return_status", "iter_count")


def main() -> None:
    """Solve until the caller is gone: ``solver_child.py FD LIMIT_S``, the serialised solver in a file."""
    stored, limit_s = int(sys.argv[1]), float(sys.argv[2])
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a Ctrl-C is the caller's, who ends this process
    requests, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a solver prints must not get among the answers
    solver = ca.Function.deserialize(os.pread(stored, os.fstat(stored).st_size, 0).decode())
    answer: object = READY
    first_s = FIRST_S
    while True:
        try:
            pickle.dump(answer, answers)
            answers.flush()
            arguments = pickle.load(requests)
        except (EOFError, BrokenPipeError):
            os._exit(0)  # what was left unsent has no reader
        signal.setitimer(signal.ITIMER_REAL, limit_s + first_s)  # SIGALRM, which ends the process
        first_s = 0.0
        try:
            solved = solver(**arguments)
        except RuntimeError:  # so CasADi reports that a solver broke off
            answer = None
        else:
            stats = solver.stats()
            values = {name: np.asarray(solved[name]).ravel() for name in OUTPUTS}
            answer = values, {name: stats.get(name) for name in STATS}
        signal.setitimer(signal.ITIMER_REAL, 0.0)


if __name__ == "__main__":
    main()
