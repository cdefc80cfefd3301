"""What every phase of a docking is: a small object made on entry, stepped until it gives a verdict."""

from __future__ import annotations

from abc import ABC, abstractmethod

from common.timing import NS_PER_S
from follower.supervisor.attempt import Attempt
from follower.supervisor.observed import Observed, Orders, Verdict


class PhaseLogic(ABC):
    """One phase; ``attempt`` is what it shares with the others, its own fields are forgotten when it ends."""

    def __init__(self, attempt: Attempt, now_ns: int) -> None:
        self.attempt = attempt
        self.limits = attempt.config.supervisor
        self.began_ns = now_ns

    @abstractmethod
    def step(self, seen: Observed) -> Orders | Verdict:
        """Take one step: what is wanted now, or how the phase ended."""

    def elapsed_s(self, seen: Observed) -> float:
        """Seconds since the phase began."""
        return (seen.now_ns - self.began_ns) / NS_PER_S


def failed(cause: str) -> Verdict:
    """The docking ends; ``cause`` is a code of :mod:`common.causes`, with a detail after a colon."""
    return Verdict("failed", cause)
