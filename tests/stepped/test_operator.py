"""An operator's requests to robots in the middle of a docking, in stepped time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from common.channels import DOCK_REQUEST, FOLLOWER_SUMMARY, LEADER_STATE, LED_REQUEST, LOCK_REQUEST, MISSION, Channel
from common.messages import Answer, DockRequest, LeaderState, LedRequest, LockRequest, Mission
from common.node import Inbox, Node, Output, Trigger
from common.timing import NS_PER_S, SteppedClock
from sim.stepped import SteppedExecutor
from tests.rigs.canbus_rig import stepped_config
from tests.rigs.stepped_rig import stepped_nodes

REQUESTS: tuple[Channel[Any], ...] = (DOCK_REQUEST, LED_REQUEST, LOCK_REQUEST)


class Operator(Node):
    """Starts a docking, and asks one thing a second once it approaches; keeps what is heard and answered."""

    name = "operator"
    inputs = (MISSION, LEADER_STATE, FOLLOWER_SUMMARY)
    outputs = REQUESTS
    trigger = Trigger(period_ns=NS_PER_S)

    def __init__(self) -> None:
        self.answers: dict[str, Answer] = {}
        self.mission: Mission | None = None
        self.leader: LeaderState | None = None
        self.phases: list[str] = []
        self._left: list[tuple[Channel[Any], Any]] = []
        self._started = False

    def step(self, now_ns: int, inputs: Inbox) -> Sequence[Output]:
        for channel in REQUESTS:
            self.answers.update({answer.id: answer for answer in inputs.answers(channel)})
        self.mission, self.leader = inputs.fresh(MISSION, now_ns), inputs.fresh(LEADER_STATE, now_ns)
        summary = inputs.fresh(FOLLOWER_SUMMARY, now_ns)
        if self.mission is None or summary is None:
            return ()
        self.phases.append(summary.phase)
        until_ns = now_ns + NS_PER_S
        if not self._started:
            self._started = True
            self._left = [
                (LED_REQUEST, LedRequest("dim", 1000, 2, 0.9)),
                (DOCK_REQUEST, DockRequest("again", until_ns + 60 * NS_PER_S, "start")),
                (LOCK_REQUEST, LockRequest("close", 1000, "lock")),
                (DOCK_REQUEST, DockRequest("abort", until_ns + 60 * NS_PER_S, "abort")),
            ]
            return ((DOCK_REQUEST, DockRequest("start", until_ns, "start")),)
        return (self._left.pop(0),) if self._left and self.mission.phase == "approach" else ()


def test_an_operator_asks_and_stops_a_docking_under_way(tmp_path: Path) -> None:
    config, clock, operator = stepped_config("world.start=[5.0,0.2,0.0]"), SteppedClock(), Operator()
    with SteppedExecutor([*stepped_nodes(config, tmp_path, clock), operator], clock) as executor:
        executor.run(clock.now_ns() + 20 * NS_PER_S, lambda: "abort" in operator.answers)
        executor.run(clock.now_ns() + 2 * NS_PER_S)
    outcomes = {request: answer.outcome for request, answer in operator.answers.items()}
    assert outcomes == {"start": "accepted", "dim": "done", "again": "refused", "close": "refused", "abort": "done"}
    assert operator.answers["close"].reason == "no beam in the guide"
    assert "approach" in operator.phases
    assert operator.leader is not None
    assert operator.leader.led_setpoint_a[2] == 0.9
    assert operator.leader.lock == "open"
    assert operator.mission is not None
    assert (operator.mission.phase, operator.mission.cause, operator.mission.armed) == (
        "aborted",
        "operator_abort",
        False,
    )
