"""Which of the arrays in sight is our Leader's: each is followed until one has shown our code.

Used where the pair has a code, before there is a track. What geometry cannot tell apart, the code can.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from common.config import LedCodeConfig
from common.frames.ring import Image
from common.geometry import Array
from common.messages import StateCause
from common.timing import NS_PER_MS, NS_PER_S
from follower.estimator.identity.code_receiver import CodeReceiver
from follower.estimator.spots import SpotRule
from follower.estimator.tracking import ArrayTracker, Followed, predict_state

MOST_ARRAYS = 4
_UNSEEN_NS = 300 * NS_PER_MS
_SEARCH_NS = 500 * NS_PER_MS
_SAME_M = 0.25
Find = Callable[[list[Array]], "list[Followed] | StateCause"]


@dataclass(frozen=True)
class Candidate:
    """An array that may be ours: as last seen, and what it has shown of a code."""

    capture_ns: int
    seen_ns: int
    found: Followed
    state: Array
    receiver: CodeReceiver


@dataclass(frozen=True)
class Sorted:
    """What one frame gave: ours if it is known by now (``own``), else the reason why not; the best one in sight."""

    cause: StateCause
    own: Candidate | None
    best: Followed | None
    spots: int


class Sorting:
    """Follows up to :data:`MOST_ARRAYS` arrays at a time; one call per frame, in order.

    Args:
        code: of the pair.
        rate_hz: of the camera.
        tracker: finds an array around its predicted state.
    """

    def __init__(self, code: LedCodeConfig, rate_hz: float, tracker: ArrayTracker) -> None:
        self._code, self._rate_hz, self._tracker = code, rate_hz, tracker
        self._candidates: list[Candidate] = []
        self._searched_ns: int | None = None
        self._other_seen = False

    def restart(self) -> None:
        """Forget all arrays."""
        self._candidates, self._searched_ns, self._other_seen = [], None, False

    def step(self, image: Image, rule: SpotRule, capture_ns: int, twist: tuple[float, float], find: Find) -> Sorted:
        """Take one frame.

        Args:
            image: (h, w) uint8.
            rule: what counts as a spot.
            capture_ns: middle of the exposure.
            twist: measured (v [m/s], ω [rad/s]).
            find: searches the whole image for arrays; given the features (n, 2) of those already followed, which it
                leaves out.
        """
        self._candidates = [
            each for old in self._candidates if (each := self._followed(old, image, rule, capture_ns, twist))
        ]
        cause: StateCause = "confirming"
        due = self._searched_ns is None or not 0 <= capture_ns - self._searched_ns < _SEARCH_NS
        if not self._candidates or (due and len(self._candidates) < MOST_ARRAYS):
            self._searched_ns = capture_ns
            found = find([each.found.features for each in self._candidates])
            if isinstance(found, list):
                for array in found[: MOST_ARRAYS - len(self._candidates)]:
                    self._begin(array, capture_ns)
            else:
                cause = found
        return self._sorted(cause, capture_ns)

    def _begin(self, found: Followed, capture_ns: int) -> None:
        receiver = CodeReceiver(self._code, self._rate_hz)
        receiver.take(capture_ns, found.mass)
        self._candidates.append(Candidate(capture_ns, capture_ns, found, found.fitted.state, receiver))

    def _followed(
        self, old: Candidate, image: Image, rule: SpotRule, capture_ns: int, twist: tuple[float, float]
    ) -> Candidate | None:
        """The candidate in this frame; None once it has not been seen for too long."""
        elapsed_ns = capture_ns - old.capture_ns
        unseen = round((capture_ns - old.seen_ns) * self._rate_hz / NS_PER_S) - 1
        if elapsed_ns <= 0 or capture_ns - old.seen_ns > _UNSEEN_NS:
            return None
        state = predict_state(old.state, twist, elapsed_ns / NS_PER_S)
        found = self._tracker.follow(image, rule, state, old.found.mass, max(unseen, 0))
        if not isinstance(found, Followed):
            return replace(old, capture_ns=capture_ns, state=state)
        old.receiver.take(capture_ns, found.seen_mass)
        return Candidate(capture_ns, capture_ns, found, found.fitted.state, old.receiver)

    def _sorted(self, cause: StateCause, capture_ns: int) -> Sorted:
        current = [each for each in self._candidates if each.seen_ns == capture_ns]
        own = [each for each in current if each.receiver.verdict == "own"]
        verdicts = [each.receiver.verdict for each in self._candidates]
        spots = sum(each.found.spots for each in current)
        if len(own) == 1:
            return Sorted("ok", own[0], own[0].found, spots)
        if len(own) > 1:  # two of our code: a mirror image, or a number given twice
            return Sorted("ambiguous", None, None, spots)
        if verdicts and all(verdict == "other" for verdict in verdicts):
            cause = "wrong_array"
        elif verdicts:
            cause = "confirming"
        best = next((each.found for each in current if each.receiver.verdict == "unknown"), None)
        return Sorted(cause, None, best, spots)
