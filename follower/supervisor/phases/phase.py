"""Base of the phases of a docking: a small object made on entry, stepped until it ends."""

from __future__ import annotations

from abc import ABC, abstractmethod

from common.timing import NS_PER_S
from follower.supervisor.attempt import Attempt
from follower.supervisor.interface import PhaseOutputs, PhaseResult, SupervisorInputs


class PhaseLogic(ABC):
    """One phase; ``attempt`` is shared with the others, its own fields end with it."""

    def __init__(self, attempt: Attempt, now_ns: int) -> None:
        self.attempt = attempt
        self.limits = attempt.config.supervisor
        self.began_ns = now_ns

    @abstractmethod
    def step(self, inputs: SupervisorInputs) -> PhaseOutputs | PhaseResult:
        """Take one step: what the phase asks for now, or how it ended."""

    def elapsed_s(self, inputs: SupervisorInputs) -> float:
        """Seconds since the phase began."""
        return (inputs.now_ns - self.began_ns) / NS_PER_S


def failed(cause: str) -> PhaseResult:
    """The docking ends; ``cause`` is a code of :mod:`common.causes`, with a detail after a colon."""
    return PhaseResult("failed", cause)
