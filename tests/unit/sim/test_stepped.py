"""The stepped executor's accidents: a link that is cut, a process that is gone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from common.channels import FOLLOWER_SUMMARY, LEADER_STATE, LOCK_REQUEST, Channel
from common.messages import Answer, FollowerSummary, LeaderState, LockRequest
from common.node import Inbox, Node, Output, Trigger
from common.timing import NS_PER_S, SteppedClock
from sim.stepped import SteppedExecutor

LEADER = LeaderState(True, "", (1.0,), False, "down", "open", 0.0, 0)
SUMMARY = FollowerSummary("idle", "", "", 1, False, False, False, False, False)
TENTH_NS = NS_PER_S // 10


class Speaker(Node):
    """Publishes, asks and listens ten times a second."""

    trigger = Trigger(period_ns=TENTH_NS)

    def __init__(self, name: str) -> None:
        self.name = name
        leads = name == "leader"
        self._heard: Channel[Any] = FOLLOWER_SUMMARY if leads else LEADER_STATE
        self.inputs = (self._heard,)
        self.serves = (LOCK_REQUEST,) if leads else ()
        self.heard_ns: list[int] = []
        self.answered = 0
        self._asked = 0

    def step(self, now_ns: int, inputs: Inbox) -> Sequence[Output]:
        if inputs.arrived(self._heard) is not None:
            self.heard_ns.append(now_ns)
        if self.serves:
            done = [(LOCK_REQUEST, Answer(r.message.id, "done", "")) for r in inputs.requests(LOCK_REQUEST)]
            return [(LEADER_STATE, LEADER), *done]
        self.answered += len(inputs.answers(LOCK_REQUEST))
        if now_ns % TENTH_NS:
            return ()  # woken by an answer
        self._asked += 1
        return [(FOLLOWER_SUMMARY, SUMMARY), (LOCK_REQUEST, LockRequest(f"{self._asked}", 1000, "lock"))]


def pair() -> tuple[SteppedExecutor, Speaker, Speaker, SteppedClock]:
    clock = SteppedClock(0)
    leader, follower = Speaker("leader"), Speaker("follower-supervisor")
    return SteppedExecutor([leader, follower], clock), leader, follower, clock


def test_from_the_cut_on_nothing_passes_between_the_robots() -> None:
    executor, leader, follower, _ = pair()
    executor.cut_link(NS_PER_S)
    with executor:
        executor.run(3 * NS_PER_S)
    for node in (leader, follower):
        assert len(node.heard_ns) >= 9
        assert max(node.heard_ns) <= NS_PER_S + TENTH_NS
    assert 8 <= follower.answered <= 10


def test_a_node_that_missed_a_step_takes_it_as_soon_as_it_goes_on() -> None:
    executor, leader, _, clock = pair()
    steps_ns: list[int] = []
    step = leader.step
    leader.step = lambda now_ns, inputs: steps_ns.append(now_ns) or step(now_ns, inputs)  # type: ignore[method-assign, func-returns-value]
    with executor:
        executor.run(NS_PER_S)
        executor.halt("leader")
        executor.run(3 * NS_PER_S)
        before = clock.now_ns()
        executor.resume("leader")
        executor.run(4 * NS_PER_S)
    assert min(at_ns for at_ns in steps_ns if at_ns > NS_PER_S) == before


def test_a_halted_node_neither_speaks_nor_answers() -> None:
    executor, leader, follower, clock = pair()
    with executor:
        executor.run(NS_PER_S)
        executor.halt("leader")
        executor.run(3 * NS_PER_S)
        assert clock.now_ns() > 2 * NS_PER_S
        assert max(leader.heard_ns) <= NS_PER_S
        assert max(follower.heard_ns) <= NS_PER_S + TENTH_NS
        assert follower.answered <= 11
        executor.resume("leader")
        executor.run(4 * NS_PER_S)
    assert min(heard_ns for heard_ns in leader.heard_ns if heard_ns > NS_PER_S) >= 3 * NS_PER_S - TENTH_NS
    assert max(follower.heard_ns) > 3 * NS_PER_S
