"""The Leader's lock moves only where a beam is, stops where it jams, and answers by name."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import pytest

from common.config import Config
from common.messages import Answer, LeaderState, LockRequest
from common.timing import NS_PER_S
from leader.sequence import IoInputs, IoOutputs, LeaderSequence

DARK = IoInputs((0.0,) * 4, 0.0, False, False, False, True)
SEATED = replace(DARK, led_current_a=(1.0,) * 4, beam_seated=True)


@dataclass
class Bench:
    config: Config
    seen: IoInputs = SEATED
    now_ns: int = NS_PER_S
    answers: list[Answer] = field(default_factory=list)
    outputs: IoOutputs | None = None
    state: LeaderState | None = None

    def __post_init__(self) -> None:
        self.sequence = LeaderSequence(self.config.leader, self.config.leds)

    def run(self, seconds: float, **changes: object) -> LeaderState:
        self.seen = replace(self.seen, **changes)  # type: ignore[arg-type]
        for _ in range(round(seconds * 50)):
            self.now_ns += NS_PER_S // 50
            self.state, answers = self.sequence.step(self.now_ns, self.seen)
            self.outputs = self.sequence.outputs
            self.answers += answers
        assert self.state is not None
        return self.state

    def ask(self, action: str, age_ns: int = 0) -> str:
        request = LockRequest(f"{action}-{self.now_ns}", 5000, action)  # type: ignore[arg-type]
        self.sequence.request(request, self.now_ns - age_ns, self.now_ns, self.seen)
        return request.id


@pytest.fixture
def bench(config: Config) -> Bench:
    return Bench(config)


def test_leds_are_on_unasked_and_a_dead_one_is_named(bench: Bench) -> None:
    state = bench.run(0.1)
    assert bench.outputs is not None
    assert bench.outputs.led_current_a == (1.0,) * 4
    assert (state.ready, state.led_fault) == (True, False)
    state = bench.run(0.3, led_current_a=(1.0, 1.0, 0.0, 1.0))
    assert not state.led_fault
    state = bench.run(0.5)
    assert state.led_fault
    assert "LED 2 draws 0.00 A" in state.cause


def test_locking_extends_until_the_switch_and_answers_then(bench: Bench) -> None:
    request_id = bench.ask("lock")
    bench.run(1.0, actuator_current_a=1.2, lock_retracted=False)
    assert bench.outputs is not None
    assert bench.outputs.actuator_extend
    assert bench.answers == []
    state = bench.run(0.1, lock_extended=True)
    assert (state.lock, state.queue) == ("locked", 1)
    assert not bench.outputs.actuator_extend
    assert bench.answers == [Answer(request_id, "done", "locked")]
    bench.ask("lock")
    assert bench.run(0.1).queue == 1
    assert bench.answers[-1].reason == "already locked"


@pytest.mark.parametrize(
    ("extended", "retracted", "lock"), [(True, False, "locked"), (False, True, "open"), (False, False, "fault")]
)
def test_after_a_start_the_lock_is_where_its_switches_say(
    bench: Bench, extended: bool, retracted: bool, lock: str
) -> None:
    assert bench.run(0.1, lock_extended=extended, lock_retracted=retracted).lock == lock


def test_without_a_beam_it_does_not_lock(bench: Bench) -> None:
    bench.run(0.1, beam_seated=False)
    bench.ask("lock")
    state = bench.run(0.2)
    assert state.lock == "open"
    assert (bench.answers[0].outcome, bench.answers[0].reason) == ("refused", "no beam in the guide")


@pytest.mark.parametrize(
    ("changes", "named"), [({"actuator_current_a": 6.0}, "current limit"), ({"actuator_current_a": 1.0}, "in time")]
)
def test_a_jam_stops_the_actuator_and_is_named(bench: Bench, changes: dict[str, object], named: str) -> None:
    bench.ask("lock")
    state = bench.run(4.0, **changes)
    assert bench.outputs is not None
    assert (state.lock, bench.outputs.actuator_extend) == ("fault", False)
    assert named in bench.answers[0].reason
    bench.ask("lock")
    bench.run(0.1)
    assert bench.answers[-1].reason.startswith("lock fault")


def test_unlocking_retracts_and_a_second_request_meanwhile_is_refused(bench: Bench) -> None:
    bench.ask("lock")
    bench.run(0.1, lock_extended=True, lock_retracted=False)
    bench.ask("unlock")
    bench.ask("lock")
    bench.run(0.1)
    assert bench.outputs is not None
    assert bench.outputs.actuator_retract
    assert "busy" in bench.answers[-1].reason
    assert bench.run(0.1, lock_extended=False, lock_retracted=True).lock == "open"


def test_a_request_that_waited_too_long_is_not_carried_out(bench: Bench) -> None:
    bench.ask("lock", age_ns=6 * NS_PER_S)
    assert bench.run(0.1).lock == "open"
    assert bench.answers[0].outcome == "expired"
