"""Requests one docking after the other, as an operator would. Pure; time is an argument."""

from __future__ import annotations

from common.messages import Answer, DockRequest, LockRequest, Mission
from common.timing import NS_PER_S

_VALID_S = 5
_REPEAT_NS = NS_PER_S
_MOST_REPEATS = 5
_NEXT_NS = NS_PER_S // 2
_ENDED = ("done", "aborted")


class Collector:
    """Requests dockings of trolleys ``first`` … ``first + count − 1``; a docking that fails ends the collection.

    If ``first`` is not 1 it first sets the Leader's count of the queue. A request is repeated with its id until it is
    answered.
    """

    def __init__(self, first: int, count: int, start_ns: int, name: str = "collect") -> None:
        self.trolley = first
        self.finished = False
        self.refused = ""
        self._last = first + count - 1
        self._name = name
        self._due_ns = start_ns
        self._repeats = 0
        self._counted = first == 1
        self._accepted = False
        self._ended = False

    def take(self, mission: Mission) -> None:
        """Take the supervisor's newest mission."""
        self._ended = self._accepted and mission.trolley == self.trolley and mission.phase in _ENDED
        if self._ended and (mission.phase == "aborted" or self.trolley == self._last):
            self.finished = True

    def answered(self, answer: Answer) -> None:
        """Take the answer to a request."""
        if answer.id == self._id("count") and not self._counted:
            self._counted = answer.outcome == "done"
        elif answer.id == self._id("dock") and not self._accepted:
            self._accepted = answer.outcome in ("accepted", "done")
        else:
            return
        self._repeats, self._due_ns = 0, 0
        if answer.outcome not in ("accepted", "done"):
            self._fail(f"request {answer.id} {answer.outcome}: {answer.reason}")

    def step(self, now_ns: int) -> DockRequest | LockRequest | None:
        """The request to send now, if any."""
        if self._ended and not self.finished:
            self.trolley += 1
            self._accepted = self._ended = False
            self._due_ns = now_ns + _NEXT_NS
        if self.finished or self._accepted or now_ns < self._due_ns:
            return None
        if self._repeats == _MOST_REPEATS:
            self._fail(f"the {'supervisor' if self._counted else 'Leader'} does not answer")
            return None
        self._repeats += 1
        self._due_ns = now_ns + _REPEAT_NS
        if not self._counted:
            return LockRequest(
                id=self._id("count"),
                valid_for_ms=1000 * _VALID_S,
                action="count",
                trolley=self.trolley - 1,
                confirmed=True,
            )
        return DockRequest(self._id("dock"), now_ns + _VALID_S * NS_PER_S, "start", self.trolley)

    def _id(self, what: str) -> str:
        return f"{self._name}-{what}-{self.trolley}"

    def _fail(self, why: str) -> None:
        self.refused, self.finished = why, True
