"""Docks one trolley after the other for as long as a soak of real processes takes. Pure; time is an argument."""

from __future__ import annotations

from collections import Counter
from typing import Literal

from common.messages import LeaderState, Mission

MOST_TROLLEYS = 28
PERIOD_S = 60.0
TRIES = 3
_PATIENCE_S, _LIMIT_S = 2.0, 200.0
Action = Literal["start", "reset"]


class Operator:
    """Begins a docking a minute at most; one that was aborted is tried again, three times in all.

    ``ends`` counts how dockings ended; ``under_way``: one that it began has not ended; ``given_up`` names
    the trolley after which none was begun.
    """

    def __init__(self) -> None:
        self.trolley = 1
        self.ends: Counter[str] = Counter()
        self.given_up = ""
        self._tries = 0
        self.under_way = False
        self._began_s = self._due_s = 0.0

    def step(self, now_s: float, mission: Mission | None, leader: LeaderState | None) -> Action | None:
        """What to ask for now, if anything."""
        if mission is None or self.given_up or self.trolley > MOST_TROLLEYS:
            return None
        if self.under_way:
            ended = mission.phase in ("done", "aborted") and mission.trolley == self.trolley
            if now_s - self._began_s > _LIMIT_S:
                self._end(now_s, "not ended by name", locked=False)
            elif ended and now_s - self._began_s > _PATIENCE_S:
                locked = leader is not None and (leader.queue or 0) >= self.trolley
                self._end(now_s, "done" if mission.phase == "done" else mission.cause, locked)
            return None
        if now_s < self._due_s:
            return None
        return "reset" if mission.phase == "aborted" else "start"

    def answered(self, now_s: float, action: Action, accepted: bool) -> None:
        """What came of the request."""
        self._due_s = now_s + _PATIENCE_S
        if action == "start" and accepted:
            self.under_way, self._began_s = True, now_s

    def _end(self, now_s: float, how: str, locked: bool) -> None:
        self.ends[how] += 1
        self.under_way = False
        self._tries += 1
        if how == "done" or locked:
            self.trolley, self._tries = self.trolley + 1, 0
            self._due_s = max(now_s + _PATIENCE_S, self._began_s + PERIOD_S)
        elif self._tries == TRIES:
            self.given_up = f"trolley {self.trolley}: {how}"
        else:
            self._due_s = now_s + _PATIENCE_S
