"""Judges one run by the world's truth and by what the bus carried. Pure: a trace in, a verdict out."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from dataclasses import dataclass

from common.config import Config
from common.timing import NS_PER_MS, NS_PER_S
from experiments.campaign.rows import Row
from experiments.campaign.trace import BusSample, Trace
from experiments.campaign.unsafe import unsafe_motion

_TOGETHER_MS = 300.0
_NEAR_NS = 20 * NS_PER_MS
_STOPPED, _OFF_WITHIN_NS = ("stopped", "disarmed", "fault"), 3 * NS_PER_S


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """One run, judged; ``ms`` is the time to the reaction, None without one."""

    row: str
    phase: str
    fault: str
    seed: int
    control: str
    reaction: str
    ms: float | None
    cause: str
    end: str
    unsafe: tuple[str, ...]
    wrong_reaction: bool
    wrong_cause: bool
    late: bool

    @property
    def right(self) -> bool:
        """Nothing of it is red."""
        return not (self.unsafe or self.wrong_reaction or self.wrong_cause or self.late)

    @property
    def text(self) -> str:
        """One line for those who mend it."""
        faults = [*self.unsafe]
        faults += ["wrong reaction"] * self.wrong_reaction + ["wrong cause"] * self.wrong_cause
        faults += ["late"] * self.late
        ms = "–" if self.ms is None else f"{self.ms:.0f} ms"
        line = f"{self.row} {self.fault} in {self.phase}, seed {self.seed}: {', '.join(faults) or 'right'}"
        return f"{line} ({self.reaction} after {ms}, cause {self.cause!r}, end {self.end!r})"


def judge(
    row: Row,
    phase: str,
    fault: str,
    seed: int,
    trace: Trace,
    reference: list[BusSample],
    config: Config,
    to_end: bool = False,
    control: str = "",
) -> Verdict:
    """The verdict on one run.

    Args:
        row: what docs/safety.md expects.
        phase: of the docking, when the fault began.
        fault: its name.
        seed: of the run.
        trace: what happened.
        reference: what the bus carried in the same time without the fault.
        config: the robots.
        to_end: the run was followed to the docking's end.
        control: the check that was removed, or empty.
    """
    reaction, ms = reaction_of(trace, reference)
    if phase == "idle":
        reaction, ms = ("moved" if _ever_armed(trace) else "refuse"), None
    if trace.outcome:
        reaction = trace.outcome
    still = not any(sample.commanded for sample in reference[:2])
    allowed = row.expected(phase, still)
    cause = first_cause(trace)
    reacted = reaction not in ("none", "moved") and not trace.outcome
    wrong_end = to_end and bool(row.ends) and not _named(trace.end, row.ends)
    unsafe = unsafe_motion(row, phase, trace, reference, config)
    return Verdict(
        row=row.id,
        phase=phase,
        fault=fault,
        seed=seed,
        control=control,
        reaction=reaction,
        ms=ms,
        cause=cause,
        end=trace.end,
        unsafe=tuple(unsafe),
        wrong_reaction=reaction not in allowed,
        wrong_cause=(reacted and bool(row.causes) and not _named(cause, row.causes)) or wrong_end,
        late=row.limit_ms is not None and fault not in row.slow and ms is not None and ms > row.limit_ms,
    )


def broken(row: str, phase: str, fault: str, seed: int, control: str, why: str) -> Verdict:
    """A run that the experiment itself could not do, of these names: red.

    Args:
        row, phase, fault, seed, control: as in :class:`Verdict`.
        why: a traceback; its last line is kept.
    """
    last_line = why.strip().rpartition("\n")[2]
    unsafe = (f"the experiment failed: {last_line}",)
    return Verdict(
        row=row, phase=phase, fault=fault, seed=seed, control=control, reaction="none", ms=None, cause="", end="",
        unsafe=unsafe, wrong_reaction=False, wrong_cause=False, late=False,
    )  # fmt: skip


def reaction_of(trace: Trace, reference: list[BusSample]) -> tuple[str, float | None]:
    """What the bus shows as reaction, and how long after the fault.

    Against the reference: set-points that become zero while they would not have without the fault, and drives that
    leave operation. A stop is a disarmed one if the bridge reports so at once, or drives leave operation. Arms may
    be led on while the base brakes, and leave it within 3 s then.
    """
    end_ns = reference[-1].t_ns if reference else trace.fault_ns
    times = [sample.t_ns for sample in reference]
    zero_ns = next(
        (s.t_ns for s in trace.bus if not s.commanded and s.t_ns <= end_ns and _moves(reference, times, s.t_ns)), None
    )
    was_on = trace.bus[0].arms_on and trace.bus[0].wheels_on
    off = (s.t_ns for s in trace.bus if not (s.arms_on and s.wheels_on) and not _off_anyway(reference, times, s.t_ns))
    latched = "S2" if "reset" in trace.refused else "S1"
    if not was_on and trace.end not in ("", "done"):
        return latched, None  # nothing was armed, and nothing will be
    off_ns = next(off, None) if was_on and trace.end != "done" else None
    reported_ns = next((s.t_ns for s in trace.drives if s.state in _STOPPED and s.t_ns >= trace.fault_ns), None)
    if off_ns is not None and reported_ns is not None and off_ns - reported_ns < _OFF_WITHIN_NS:
        off_ns = min(off_ns, reported_ns)
    if off_ns is not None and (zero_ns is None or off_ns - zero_ns <= _TOGETHER_MS * NS_PER_MS):
        moving = bool(reference) and reference[0].commanded
        first_ns = max(zero_ns, trace.fault_ns) if zero_ns is not None and moving else off_ns
        return latched, _ms(trace, first_ns)
    if zero_ns is not None:
        return "S0", _ms(trace, zero_ns)
    return "none", None


def first_cause(trace: Trace) -> str:
    """The first that any process gave as the reason for what it did."""
    reported = [(s.t_ns, 0, s.cause) for s in trace.drives if s.state in ("stopped", "fault")]
    reported += [(s.t_ns, 1, s.cause) for s in trace.missions if s.phase == "aborted"]
    reported += [(s.t_ns, 2, s.waiting) for s in trace.missions if s.waiting and s.phase != "aborted"]
    reported = [entry for entry in reported if entry[2] and not _named(entry[2], _NO_CAUSE)]
    return min(reported)[2] if reported else trace.refused


_NO_CAUSE = ("drives", "health", "LEDs", "staging pose", "the Leader's lock", "grippers to open", "standstill",
             "trolley", "grip on the trolley")  # fmt: skip


def _named(text: str, names: tuple[str, ...]) -> bool:
    """Whether a cause is one of those; a name that ends with * matches within the text."""
    return any(name[:-1] in text if name.endswith("*") else text.partition(":")[0] == name for name in names)


def _ms(trace: Trace, t_ns: int) -> float:
    return (t_ns - trace.fault_ns) / NS_PER_MS


def _moves(reference: list[BusSample], times: list[int], t_ns: int) -> bool:
    """Whether it would have been commanded to move then, and some 20 ms before and after."""
    near = reference[bisect_left(times, t_ns - _NEAR_NS) : bisect_right(times, t_ns + _NEAR_NS)]
    return bool(near) and all(s.commanded for s in near)


def _off_anyway(reference: list[BusSample], times: list[int], t_ns: int) -> bool:
    """Whether drives would have been out of operation at that time without the fault as well."""
    if not reference or t_ns > times[-1]:
        return False
    sample = reference[max(0, bisect_right(times, t_ns) - 1)]
    return not (sample.arms_on and sample.wheels_on)


def _ever_armed(trace: Trace) -> bool:
    return any(sample.wheels_on or sample.arms_on for sample in trace.bus)
