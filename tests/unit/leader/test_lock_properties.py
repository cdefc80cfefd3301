"""The lock under random events: never open under a Follower, no dead end. ``make prove`` takes many more."""

from __future__ import annotations

import os
import random
from dataclasses import replace
from typing import Any

import pytest

from common.config import Config
from common.messages import Answer, FollowerSummary, LockRequest, LockState
from common.timing import NS_PER_S
from leader.lock import BoltLock, LockInputs
from tests.rigs.leader_rig import AWAY, HOLDING, MOVING

EVENTS = int(os.environ.get("MACHINE_EVENTS", "100000"))
WALKS = 8
OPEN = LockInputs(
    actuator_current_a=0.0, guide_lifted=False, beam_seated=True, lock_extended=False, lock_retracted=True
)


def harmless(follower: FollowerSummary | None) -> bool:
    """Whether the Follower is heard to stand and to hold nothing against the queue."""
    return follower is not None and not follower.moving and not follower.in_contact


class LockWalk:
    """Random switches, currents, Followers and requests around a bolt that mostly moves as commanded."""

    def __init__(self, config: Config, seed: int) -> None:
        self.random = random.Random(seed)
        self.lock = BoltLock(config.leader, self.random.choice((0, 1, 3, None)))
        self.now_ns = NS_PER_S
        self.travel = self.random.choice((0.0, 1.0))
        self.seated = True
        self.follower: FollowerSummary | None = AWAY
        self.broken: dict[str, int] = {}
        self.open_since_lock = True
        self.unanswered: set[str] = set()
        self.seen = OPEN
        self.state: LockState = "fault"
        self.retracting_jam = False
        self.closing_since_ns = 0
        self.contradicted = 0
        self.least_ns = round(config.leader.lock_travel_least_s * NS_PER_S)

    def step(self) -> None:
        self.now_ns += NS_PER_S // 50
        self._world()
        before = self.lock.state
        if self.random.random() < 0.03:
            self._ask()
        self._take(self.lock.step(self.now_ns, self.seen, self.follower))
        self._judge(before)

    def _world(self) -> None:
        draw = self.random.random
        if draw() < 0.01:
            name = self.random.choice(("jam", "extended", "retracted", "lost", "slow"))
            self.broken[name] = self.random.choice((1, 3, 20, 400))
        self.broken = {name: left - 1 for name, left in self.broken.items() if left > 1}
        if draw() < 0.02:
            self.follower = self.random.choice((AWAY, AWAY, MOVING, HOLDING, None))
        if draw() < 0.01 and self.lock.state == "open":
            self.seated = not self.seated
        jammed = "jam" in self.broken
        if not jammed:
            speed = 0.002 if "slow" in self.broken else 0.016
            self.travel = min(1.0, max(0.0, self.travel + speed * self.lock.direction))
        current = 6.0 if jammed and self.lock.direction else 1.2 * abs(self.lock.direction)
        self.seen = LockInputs(
            actuator_current_a=current,
            guide_lifted=False,
            beam_seated=self.seated,
            lock_extended=(self.travel >= 1.0 or "extended" in self.broken) and "lost" not in self.broken,
            lock_retracted=(self.travel <= 0.0 or "retracted" in self.broken) and "lost" not in self.broken,
        )

    def _ask(self) -> None:
        action: Any = self.random.choice(("lock", "lock", "confirm", "unlock", "reset", "reset", "count"))
        request = LockRequest(
            f"{self.now_ns}",
            5000,
            action,
            self.random.randrange(4),
            self.random.random() < 0.5,
        )
        self.unanswered.add(request.id)
        queue, state = self.lock.queue, self.lock.state
        self._take(self.lock.ask(request, self.now_ns, self.seen, self.follower))
        if self.lock.state == "opening" and state not in ("opening", "closing"):
            assert request.confirmed
            assert action in ("unlock", "reset")
            assert harmless(self.follower)
        if self.lock.state == "closing" and state == "open":
            assert self.seen.beam_seated
        if self.lock.queue != queue and state == self.lock.state:
            assert action in ("confirm", "count")

    def _take(self, answer: Answer | None) -> None:
        if answer is not None:
            assert answer.id in self.unanswered
            self.unanswered.remove(answer.id)

    def _judge(self, before: LockState) -> None:
        state, direction = self.lock.state, self.lock.direction
        assert direction == {"closing": 1, "opening": -1}.get(state, 0)
        # at rest, switches that say otherwise for more than a moment are a fault
        switches = (self.seen.lock_extended, self.seen.lock_retracted)
        at_rest = {"open": (False, True), "locked": (True, False)}.get(state, switches)
        self.contradicted = self.contradicted + 1 if state == before and switches != at_rest else 0
        assert self.contradicted <= 7
        if state == "closing" and before != "closing":
            self.closing_since_ns = self.now_ns
        if state == "locked":
            # whatever the switch says: a bolt that was open has had the time to get there
            travelled_ns = self.now_ns - self.closing_since_ns
            assert before != "closing" or not self.open_since_lock or travelled_ns >= self.least_ns - NS_PER_S // 50
            self.open_since_lock = False
        elif state == "open":
            self.open_since_lock = True
        if state == "opening":
            jam = before == "closing" or (self.retracting_jam and before == "opening")
            self.retracting_jam = jam
            # either nothing was locked yet, or the Follower is known to stand and to hold nothing
            assert harmless(self.follower) or (jam and self.open_since_lock)
        else:
            self.retracting_jam = False
        assert self.lock.queue is None or self.lock.queue >= 0
        if state == "open":
            assert self.lock.queue == 0


@pytest.mark.parametrize("seed", range(WALKS))
def test_the_lock_never_opens_under_a_follower_and_always_answers(config: Config, seed: int) -> None:
    walk = LockWalk(config, seed)
    for _ in range(EVENTS * 4 // 5 // WALKS):
        walk.step()
    assert mended(walk) == "open"
    assert walk.unanswered == set()


def mended(walk: LockWalk) -> LockState:
    """Switches right, the Follower away, and an operator who resets and unlocks: where the lock ends."""
    walk.follower, walk.broken = AWAY, {}
    for number in range(3000):
        walk.now_ns += NS_PER_S // 50
        walk.travel = min(1.0, max(0.0, walk.travel + 0.03 * walk.lock.direction))
        walk.seen = replace(OPEN, lock_extended=walk.travel >= 1.0, lock_retracted=walk.travel <= 0.0)
        walk._take(walk.lock.step(walk.now_ns, walk.seen, AWAY))
        if number in (500, 1000, 1500):
            action: Any = "reset" if walk.lock.state == "fault" else "unlock"
            request = LockRequest(f"person-{number}", 5000, action, 1, confirmed=True)
            walk.unanswered.add(request.id)
            walk._take(walk.lock.ask(request, walk.now_ns, walk.seen, AWAY))
    return walk.lock.state
