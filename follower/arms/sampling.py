"""The time between two measurements of the drives, as detectors count it."""

from __future__ import annotations

from dataclasses import dataclass

from common.timing import NS_PER_S, HeldFor


@dataclass(frozen=True)
class SampleInterval:
    """From the sample before to this one [ns]. A detector may count a long gap for less: see :class:`HandleHold`."""

    begin_ns: int
    end_ns: int

    @property
    def dt_s(self) -> float:
        """Its length [s]."""
        return (self.end_ns - self.begin_ns) / NS_PER_S


def step_held(held: HeldFor, interval: SampleInterval, holds: bool, *, stays: bool = False) -> bool:
    """Step a debouncer whose condition, when it holds at a sample, counts from the sample before.

    Args:
        held: the debouncer.
        interval: from the sample before to this one.
        holds: whether the condition holds at this sample.
        stays: release hysteresis, as in :meth:`HeldFor.step`.
    """
    held.step(interval.begin_ns, holds, stays=stays)
    return held.step(interval.end_ns, holds, stays=stays)
