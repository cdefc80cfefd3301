"""What ``davpc doctor`` reports: findings, one line a check, and probes that cannot keep it from ending.

A *check* is a pure function of what was found to a :class:`Finding`; a *probe* looks, without moving, enabling or
writing anything, and has a bounded time to do so.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Generic, Literal, TypeVar

from common.errors import ConfigError, DeviceError

Status = Literal["ok", "warning", "failed", "skipped"]
T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)
PROBING = "doctor-probe"


@dataclass(frozen=True)
class Finding:
    """One line: what was looked at, how it is, what was seen, and what to do about it ("" if nothing)."""

    check: str
    status: Status
    seen: str
    remedy: str = ""

    def line(self) -> str:
        """For people."""
        return f"{self.status:8s} {self.check:22s} {self.seen}" + (f"  → {self.remedy}" if self.remedy else "")


def ok(check: str, seen: str) -> Finding:
    """Nothing to do."""
    return Finding(check, "ok", seen)


def warning(check: str, seen: str, remedy: str) -> Finding:
    """It works, but not for long, or not as well as it could."""
    return Finding(check, "warning", seen, remedy)


def failed(check: str, seen: str, remedy: str) -> Finding:
    """A robot in this state is not to dock."""
    return Finding(check, "failed", seen, remedy)


def skipped(check: str, because: str, remedy: str = "") -> Finding:
    """Could not be looked at here."""
    return Finding(check, "skipped", f"because {because}", remedy)


@dataclass(frozen=True)
class ProbeResult(Generic[T_co]):
    """What a probe found: a value, or in one line why there is none."""

    value: T_co | None = None
    why: str = ""


def run_probe(probe: Callable[[], T], seconds: float) -> ProbeResult[T]:
    """Run a probe with a timeout, in a thread called ``PROBING``; one that hangs is abandoned.

    Args:
        probe: what to run; an exception becomes the reason why there is no value.
        seconds: the timeout.
    """
    found: list[ProbeResult[T]] = []

    def run() -> None:
        try:
            found.append(ProbeResult(probe()))
        except (ConfigError, DeviceError) as error:
            found.append(ProbeResult(why=str(error)))
        except OSError as error:
            place = f"{error.filename}: " if error.filename else ""
            found.append(ProbeResult(why=f"{place}{error.strerror or error}"))
        except Exception as error:  # noqa: BLE001 - one probe's fault must not hide what the others found
            found.append(ProbeResult(why=f"{type(error).__name__}: {str(error).partition(chr(10))[0]}"))

    thread = threading.Thread(target=run, name=PROBING, daemon=True)
    thread.start()
    thread.join(seconds)
    return found[0] if found else ProbeResult(why=f"no answer within {seconds:.0f} s")


def summary(findings: Sequence[Finding]) -> str:
    """How many of each kind; and by name what was not looked at, which may be ill all the same."""
    kinds: tuple[Status, ...] = ("failed", "warning", "ok", "skipped")
    counts = [(kind, sum(finding.status == kind for finding in findings)) for kind in kinds]
    text = ", ".join(f"{count} {kind}" for kind, count in counts if count)
    return "\n".join([text, *([f"not looked at: {', '.join(unseen(findings))}"] if unseen(findings) else [])])


def unseen(findings: Sequence[Finding]) -> list[str]:
    """Checks that were skipped."""
    return [finding.check for finding in findings if finding.status == "skipped"]


def is_well(findings: Sequence[Finding]) -> bool:
    """Whether nothing failed; warnings and skipped checks do not count."""
    return all(finding.status != "failed" for finding in findings)


def as_table(findings: Sequence[Finding]) -> dict[str, Any]:
    """For programs."""
    return {
        "ok": is_well(findings),
        "not_looked_at": unseen(findings),
        "findings": [asdict(finding) for finding in findings],
    }
