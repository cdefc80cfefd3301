"""One recorded docking as series over time, phases, events and key moments."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from common.channels import COMMAND, DOCKING_STATE, DRIVES, FRAME, LEADER_STATE, MISSION, Channel
from common.config import Config
from common.docking_errors import DockingError, docked_error
from common.errors import ConfigError
from common.geometry import Pose2
from common.messages import Command, DockingState, Drives, Frame, LeaderState, Mission
from common.recording import scene
from common.recording.recording import Recording
from common.timing import NS_PER_S

_BETWEEN = ("idle", "done", "aborted", "manual")


@dataclass(frozen=True)
class Event:
    """Something that happened at a time; ``kind`` is a phase, ``pause``, ``gate`` or ``end``."""

    time_ns: int
    kind: str
    text: str


class RecordedAttempt:
    """What a recording shows of its last docking.

    Raises:
        ConfigError: there is none in it.
    """

    def __init__(self, recording: Recording) -> None:
        self.recording = recording
        self.missions: list[tuple[int, Mission]] = self._all(MISSION)
        self.states: list[tuple[int, DockingState]] = self._all(DOCKING_STATE)
        self.commands: list[tuple[int, Command]] = self._all(COMMAND)
        self.drives: list[tuple[int, Drives]] = self._all(DRIVES)
        self.leader: list[tuple[int, LeaderState]] = self._all(LEADER_STATE)
        self.frames: list[tuple[int, Frame]] = self._all(FRAME)
        docking = [index for index, (_, mission) in enumerate(self.missions) if mission.phase not in _BETWEEN]
        if not docking:
            raise ConfigError(f"{recording.path}: holds no docking")
        last = docking[-1]
        first = last
        while first > 0 and self.missions[first - 1][1].phase not in _BETWEEN:
            first -= 1
        self.begin_ns = self.missions[first][0]
        ended = self.missions[last + 1] if last + 1 < len(self.missions) else None
        self.end_ns, self.final = ended if ended is not None else self.missions[last]
        self.complete = ended is not None
        self._under_way = self.missions[first : last + 1]

    def _all(self, channel: Channel[Any]) -> list[tuple[int, Any]]:
        """Messages with the time of their publication: what a recorder notes as receipt may be some ms later."""
        found = self.recording.messages(channel)
        if channel.reach == "pair":  # by another robot's clock
            return [(log_ns, message) for log_ns, _, message in found]
        return [(header.stamp_ns, message) for _, header, message in found]

    @property
    def config(self) -> Config:
        """Of the run."""
        return self.recording.config

    @property
    def trolley(self) -> int:
        """K."""
        return self._under_way[0][1].trolley

    @property
    def docked(self) -> bool:
        """Whether it ended as it should."""
        return self.complete and self.final.phase == "done"

    @property
    def cause(self) -> str:
        """Why it ended; empty if it docked."""
        return "" if self.docked else self.final.cause or ("the recording ends" if not self.complete else "")

    def seconds(self, time_ns: int) -> float:
        """Time since the docking began [s]."""
        return (time_ns - self.begin_ns) / NS_PER_S

    def within(self, series: list[tuple[int, Any]]) -> list[tuple[int, Any]]:
        """The part of a series that lies in the docking."""
        return [item for item in series if self.begin_ns <= item[0] <= self.end_ns]

    @cached_property
    def phases(self) -> list[tuple[str, int, int]]:
        """Each phase with its begin and its end [ns]."""
        found: list[tuple[str, int, int]] = []
        for time_ns, mission in self._under_way:
            if found and found[-1][0] == mission.phase:
                found[-1] = (mission.phase, found[-1][1], time_ns)
            else:
                if found:
                    found[-1] = (*found[-1][:2], time_ns)
                found.append((mission.phase, time_ns, time_ns))
        found[-1] = (*found[-1][:2], self.end_ns)
        return found

    @cached_property
    def events(self) -> list[Event]:
        """Phases, pauses, interventions of the gate and the end, in order."""
        events = [Event(begin_ns, name, f"phase {name}") for name, begin_ns, _ in self.phases]
        waiting = ""
        for time_ns, mission in self._under_way:
            if mission.phase == "approach" and mission.waiting and mission.waiting != waiting:
                events.append(Event(time_ns, "pause", f"pauses: waits for {mission.waiting}"))
            waiting = mission.waiting
        before = None
        for time_ns, drives in self.within(self.drives):
            if before is not None and drives.gate_interventions > before:
                events.append(Event(time_ns, "gate", f"gate: {drives.gate_intervened or 'intervened'}"))
            before = drives.gate_interventions
        events.append(Event(self.end_ns, "end", "docked" if self.docked else f"ends: {self.cause}"))
        return sorted(events, key=lambda event: event.time_ns)

    @cached_property
    def error(self) -> DockingError | None:
        """Estimated against the goal when the insertion began; else the last estimate."""
        insert = next((begin_ns for name, begin_ns, _ in self.phases if name == "insert"), self.end_ns)
        seen = [state for time_ns, state in self.within(self.states) if state.valid and time_ns <= insert]
        if not seen:
            return None
        pose = Pose2(seen[-1].x_m, seen[-1].y_m, seen[-1].theta_rad)
        return docked_error(pose.inverse(), self.config.docking.goal(self.trolley))

    @cached_property
    def key_moments(self) -> list[tuple[str, int]]:
        """First lock, pauses, contact and end, by what they are."""
        moments = [("first lock", time_ns) for time_ns, state in self.within(self.states) if state.valid][:1]
        moments += [("pause", event.time_ns) for event in self.events if event.kind == "pause"][:4]
        moments += [("contact", begin_ns) for name, begin_ns, _ in self.phases if name == "push"][:1]
        return [*moments, ("end", self.end_ns)]

    def picture(self, time_ns: int) -> tuple[int, bytes] | None:
        """The newest picture at a time, with its capture; the first one where none is older."""
        records = self.recording.topics.get(scene.IMAGE, [])
        before = [record for record in records if record.log_ns <= time_ns] or records[:1]
        return scene.read_image(before[-1].data) if before else None

    def state_of(self, capture_ns: int) -> DockingState | None:
        """What the estimator made of the frame taken then."""
        return next((state for _, state in self.states if state.capture_ns == capture_ns), None)
