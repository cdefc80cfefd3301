"""What came of malformed input: taken, refused by name, or a finding, with the input that made it."""

from __future__ import annotations

import gc
import os
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

MOST_GROWTH_BYTES = 5_000_000
_LONGEST_REFUSAL = 1000
_WARM_UP = 0.25


@dataclass
class Crash:
    """One kind of failure: its place, its text, the first input that made it, and how many did."""

    kind: str
    signature: str
    text: str
    data: bytes
    count: int = 1


@dataclass
class Tally:
    """Result of one part of the work."""

    target: str
    runs: int = 0
    taken: int = 0
    refused: int = 0
    growth_bytes: int = 0
    seconds: float = 0.0
    findings: dict[str, Crash] = field(default_factory=dict)


class BoundedCall:
    """Counts and judges the inputs of one target.

    Args:
        target: name of what is attacked.
        count: inputs that are planned; memory is compared with that after a quarter of them.
        until_s: time.monotonic() after which no more input follows; None: no such time.
    """

    def __init__(self, target: str, count: int, until_s: float | None = None) -> None:
        self.tally = Tally(target)
        self._count, self._until_s = count, until_s
        self._begin_s = time.monotonic()
        self._before_bytes: int | None = None

    @property
    def goes_on(self) -> bool:
        """Whether more inputs are due."""
        in_time = self._until_s is None or time.monotonic() < self._until_s
        return in_time and self.tally.runs < self._count

    def attempt(
        self,
        data: bytes,
        work: Callable[[], str],
        documented: tuple[type[Exception], ...] = (),
        runs: int = 1,
        label: str = "",
    ) -> None:
        """Do the work and judge it.

        Args:
            data: the input, kept if this is a finding.
            work: returns what is wrong with its result; empty if nothing is.
            documented: exceptions that refuse an input by name, in one line.
            runs: how many inputs this is.
            label: of the input, for whoever reads the finding.
        """
        tally = self.tally
        tally.runs += runs
        try:
            wrong = work()
        except documented as error:
            tally.refused += runs
            text = str(error)
            if "\n" in text or not text or len(text) > _LONGEST_REFUSAL:
                self.note("refusal", f"{type(error).__name__} is not one line", text[:_LONGEST_REFUSAL], data, label)
        except Exception as error:  # noqa: BLE001 - any other exception is what this looks for
            self.note("exception", _place(error), "".join(traceback.format_exception(error, limit=-12)), data, label)
        else:
            tally.taken += runs
            if wrong:
                self.note("limit", wrong.partition(":")[0], wrong, data, label)
        if self._before_bytes is None and tally.runs >= _WARM_UP * self._count:
            self._before_bytes = resident_bytes()

    def note(self, kind: str, signature: str, text: str, data: bytes, label: str = "") -> None:
        """Keep a finding; of the same signature the first input only.

        Args:
            kind: exception, refusal, limit or memory.
            signature: what tells it from others.
            text: traceback or explanation.
            data: the input.
            label: of the input.
        """
        known = self.tally.findings.get(signature)
        if known is None:
            self.tally.findings[signature] = Crash(kind, signature, f"{label}\n{text}".strip(), data)
        else:
            known.count += 1

    def finish(self) -> Tally:
        """The tally, with memory judged."""
        self.tally.seconds = time.monotonic() - self._begin_s
        if self._before_bytes is not None:
            self.tally.growth_bytes = resident_bytes() - self._before_bytes
        if self.tally.growth_bytes > MOST_GROWTH_BYTES:
            self.note("memory", "memory grows", f"{self.tally.growth_bytes} bytes", b"")
        return self.tally


def merged(target: str, parts: list[Tally]) -> Tally:
    """Several parts of one target as one: sums, and the largest growth."""
    whole = Tally(target)
    for part in parts:
        whole.runs += part.runs
        whole.taken += part.taken
        whole.refused += part.refused
        whole.seconds += part.seconds
        whole.growth_bytes = max(whole.growth_bytes, part.growth_bytes)
        for signature, found in part.findings.items():
            if signature in whole.findings:
                whole.findings[signature].count += found.count
            else:
                whole.findings[signature] = found
    return whole


def resident_bytes() -> int:
    """Resident memory of this process, garbage collected."""
    gc.collect()
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE")


def _place(error: BaseException) -> str:
    """The exception and where it was raised: enough to tell two findings apart."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if "/experiments/fuzz/" not in frame.filename and "/lib/" not in frame.filename]
    last = (own or list(frames))[-1]
    return f"{type(error).__name__} in {'/'.join(Path(last.filename).parts[-2:])}:{last.name}"
