"""A Leader's sequence with its inputs in the test's hand, and what a Follower reports of itself."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from common.config import Config
from common.messages import Answer, FollowerSummary, LeaderState, LockRequest
from common.timing import NS_PER_S
from leader.sequence import IoInputs, IoOutputs, LeaderSequence

SEATED = IoInputs(
    actuator_current_a=0.0,
    guide_lifted=False,
    beam_seated=True,
    lock_extended=False,
    lock_retracted=True,
    led_current_a=(1.0,) * 4,
)
LOCKED = replace(SEATED, lock_extended=True, lock_retracted=False)
HALF_WAY = replace(SEATED, lock_extended=False, lock_retracted=False)
AWAY = FollowerSummary("idle", "", "", 1, False, False, False, False, False)
MOVING = replace(AWAY, phase="approach", armed=True, moving=True)
HOLDING = replace(AWAY, phase="lock", armed=True, in_contact=True)


@dataclass
class Bench:
    config: Config
    queue: int | None = 0
    seen: IoInputs = SEATED
    follower: FollowerSummary | None = AWAY
    now_ns: int = NS_PER_S
    answers: list[Answer] = field(default_factory=list)
    led_answers: list[Answer] = field(default_factory=list)
    outputs: IoOutputs = field(init=False)

    def __post_init__(self) -> None:
        self.sequence = LeaderSequence(self.config.leader, self.config.leds, self.queue)
        self.outputs = self.sequence.outputs

    def run(self, seconds: float, **changes: Any) -> LeaderState:
        self.seen = replace(self.seen, **changes)
        for _ in range(max(1, round(seconds * 50))):
            self.now_ns += NS_PER_S // 50
            self.sequence.set_follower(self.follower)
            state, due = self.sequence.step(self.now_ns, self.seen)
            self.outputs = self.sequence.outputs
            self.answers += due.lock
            self.led_answers += due.led
        return state

    def ask(self, action: str, age_ns: int = 0, **kwargs: Any) -> str:
        request = LockRequest(f"{action}-{self.now_ns}", 5000, action, **kwargs)  # type: ignore[arg-type]
        self.sequence.set_follower(self.follower)
        self.sequence.request(request, self.now_ns - age_ns, self.now_ns, self.seen)
        return request.id

    def answer(self, action: str, **kwargs: Any) -> Answer:
        """Of a request that is answered at once."""
        asked = self.ask(action, **kwargs)
        self.run(0.02)
        assert self.answers[-1].id == asked
        return self.answers[-1]

    def to_locked(self, trolleys: int = 1) -> None:
        self.ask("lock")
        self.run(1.0, lock_retracted=False, actuator_current_a=1.2)
        self.run(0.1, lock_extended=True, actuator_current_a=0.0)
        for trolley in range(2, trolleys + 1):
            assert self.answer("confirm", trolley=trolley).outcome == "done"
