"""What the robots still deliver, and what gives first: ages at a reader, gaps in the commands, missed periods."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from common.channels import DOCKING_STATE, DRIVES, LEADER_STATE, Channel
from common.messages import Drives, Message, MessageError, decode
from common.timing import NS_PER_MS, NS_PER_S
from experiments.shared.fleet import Fleet
from experiments.stop_times.watch import LONGEST_GAP_NS, WheelNotes

GAP = "commands on the bus"
WATCHED: dict[str, Channel[Any]] = {
    "docking state": DOCKING_STATE, "drives": DRIVES, "Leader's state": LEADER_STATE,
}  # fmt: skip
LIMITS_NS = {GAP: LONGEST_GAP_NS} | {name: channel.max_age_ns for name, channel in WATCHED.items()}


@dataclass
class Ages:
    """The worst age of each thing [ns], when it first gave, and when it was last beyond its limit. Pure.

    ``gave``: seconds after the begin, by what gave.
    """

    begin_ns: int
    worst_ns: dict[str, int] = field(default_factory=dict)
    gave_s: dict[str, float] = field(default_factory=dict)
    last_over_ns: int | None = None

    def note(self, name: str, age_ns: int, now_ns: int) -> None:
        """Something was so old."""
        self.worst_ns[name] = max(age_ns, self.worst_ns.get(name, 0))
        if age_ns > LIMITS_NS[name]:
            self.last_over_ns = now_ns
            self.gives(f"{name} older than {LIMITS_NS[name] / NS_PER_MS:g} ms", now_ns)

    def gives(self, what: str, now_ns: int) -> None:
        """It gave; only the first time counts."""
        self.gave_s.setdefault(what, (now_ns - self.begin_ns) / NS_PER_S)

    @property
    def order(self) -> list[str]:
        """What gave, the first first."""
        return [f"{at_s:.1f} s {what}" for what, at_s in sorted(self.gave_s.items(), key=lambda each: each[1])]


class LoadWatch:
    """Looks at a fleet and the tap on its bus; :meth:`look` as often as possible."""

    def __init__(self, fleet: Fleet, notes: WheelNotes) -> None:
        self._fleet, self._notes = fleet, notes
        self._stamps_ns: dict[str, int] = {}
        self.image_to_can_ns = 0
        self._missed_before: dict[str, int] = {}
        self._cause = ""
        self.restart()
        for name, channel in WATCHED.items():
            fleet.bus.subscribe(channel, self._reader(name, channel))

    def restart(self) -> None:
        """Forget what was seen."""
        self._notes.restart()
        self.ages = Ages(time.monotonic_ns())
        self.image_to_can_ns = 0
        self._missed_before = self._missed_periods()

    def look(self) -> None:
        """Note ages as a reader finds them now."""
        now_ns = time.monotonic_ns()
        for name, stamp_ns in list(self._stamps_ns.items()):
            self.ages.note(name, now_ns - stamp_ns, now_ns)
        if self._notes.last_rpdo_ns is not None:
            self.ages.note(GAP, max(now_ns - self._notes.last_rpdo_ns, self._notes.longest_gap_ns), now_ns)
            self._notes.longest_gap_ns = 0
        for name, count in self.missed().items():
            if count:
                self.ages.gives(f"{name} misses periods", now_ns)
        mission = self._fleet.mission
        cause = mission.cause if mission is not None else ""
        if cause and cause != self._cause:
            self.ages.gives(f"the supervisor reports {cause}", now_ns)
        self._cause = cause

    def missed(self) -> dict[str, int]:
        """Periods that each process missed since the restart."""
        return {name: count - self._missed_before.get(name, 0) for name, count in self._missed_periods().items()}

    def _missed_periods(self) -> dict[str, int]:
        return {name: health.missed_periods for name, health in dict(self._fleet.health).items()}

    def _reader(self, name: str, channel: Channel[Any]) -> Callable[[bytes], None]:
        kind: type[Message] = channel.message

        def read(payload: bytes) -> None:
            try:
                header, message = decode(kind, payload)
            except MessageError:
                return  # an impostor's
            now_ns = time.monotonic_ns()
            self._stamps_ns[name] = now_ns if channel.reach == "pair" else header.stamp_ns
            if isinstance(message, Drives):
                self.image_to_can_ns = max(self.image_to_can_ns, message.image_to_can_ns)

        return read
