"""The Leader's lock moves only where a beam is and a Follower stands, stops where it jams, and answers by name."""

from __future__ import annotations

import pytest

from common.config import Config, LedCodeConfig
from common.led_code import SYMBOLS, level
from common.messages import Answer, FollowerSummary, LedRequest
from common.timing import NS_PER_MS, NS_PER_S
from leader.sequence import IoInputs
from tests.rigs.leader_rig import HALF_WAY, HOLDING, LOCKED, MOVING, SEATED, Bench


@pytest.fixture
def bench(config: Config) -> Bench:
    return Bench(config)


# --- lock


def test_locking_extends_until_the_switch_and_answers_then(bench: Bench) -> None:
    request_id = bench.ask("lock")
    bench.run(1.0, actuator_current_a=1.2, lock_retracted=False)
    assert bench.outputs.actuator == 1
    assert bench.answers == []
    state = bench.run(0.1, lock_extended=True)
    assert (state.lock, state.queue, bench.outputs.actuator) == ("locked", 1, 0)
    assert bench.answers == [Answer(request_id, "done", "locked")]
    assert bench.answer("lock").reason == "already locked"
    assert bench.sequence.queue == 1


def test_later_trolleys_are_confirmed_and_counted_once(bench: Bench) -> None:
    assert bench.answer("confirm", trolley=2).reason == "the lock is open"
    bench.to_locked()
    assert bench.answer("confirm", trolley=2).outcome == "done"
    assert bench.answer("confirm", trolley=2).outcome == "done"
    assert bench.run(0.1).queue == 2
    assert bench.answer("confirm", trolley=5).reason == "the queue has 2 trolleys, not 4"


@pytest.mark.parametrize(
    ("extended", "retracted", "lock"), [(True, False, "locked"), (False, True, "open"), (False, False, "fault")]
)
def test_after_a_start_the_lock_is_where_its_switches_say(
    bench: Bench, extended: bool, retracted: bool, lock: str
) -> None:
    assert bench.run(0.1, lock_extended=extended, lock_retracted=retracted).lock == lock


def test_without_a_beam_it_does_not_lock(bench: Bench) -> None:
    bench.run(0.1, beam_seated=False)
    assert bench.answer("lock") == Answer(bench.answers[0].id, "refused", "no beam in the guide")
    assert bench.run(0.1).lock == "open"


@pytest.mark.parametrize(
    ("changes", "named", "within_s"),
    [({"actuator_current_a": 6.0}, "current limit", 0.1), ({"actuator_current_a": 1.0}, "in time", 3.1)],
)
def test_a_jam_is_retracted_once_then_latched_until_an_operator_resets(
    bench: Bench, changes: dict[str, object], named: str, within_s: float
) -> None:
    bench.follower = HOLDING
    bench.ask("lock")
    bench.run(within_s, lock_retracted=False, **changes)
    assert bench.outputs.actuator == -1
    state = bench.run(0.5, lock_retracted=True, actuator_current_a=0.0)
    assert (state.lock, bench.outputs.actuator, state.ready) == ("fault", 0, False)
    assert named in bench.answers[-1].reason
    assert bench.answers[-1].outcome == "refused"
    assert bench.answer("lock").reason.startswith("lock fault")
    assert bench.answer("reset").reason == "open"
    assert bench.run(0.1).lock == "open"


def test_a_jam_that_cannot_be_retracted_stops_the_actuator(bench: Bench) -> None:
    bench.ask("lock")
    bench.run(7.0, lock_retracted=False)
    assert bench.run(0.1).lock == "fault"
    assert bench.outputs.actuator == 0
    assert "retracted switch" in bench.answers[-1].reason


def test_a_switch_that_sticks_closed_on_the_way_is_not_a_lock(bench: Bench) -> None:
    bench.follower = HOLDING
    bench.ask("lock")
    bench.run(0.2, lock_retracted=False, actuator_current_a=1.2)
    state = bench.run(0.02, lock_extended=True)
    assert (state.lock, state.queue, bench.outputs.actuator) == ("opening", 0, -1)
    state = bench.run(4.0, lock_retracted=True, actuator_current_a=0.0)
    assert (state.lock, bench.outputs.actuator) == ("fault", 0)
    assert (
        bench.answers[-1].reason
        == "lock switch closed after 0.22 s, before the bolt can have arrived; both lock switches closed"
    )
    assert "both lock switches" in bench.answer("reset", confirmed=True).reason


@pytest.mark.parametrize(
    ("start", "changes", "named"),
    [
        (SEATED, {"lock_extended": True}, "lock switch closed while the lock is open"),
        (SEATED, {"lock_retracted": False}, "retracted switch lost"),
        (LOCKED, {"lock_extended": False}, "lock switch lost while locked"),
        (LOCKED, {"lock_retracted": True}, "retracted switch closed while locked"),
    ],
)
def test_switches_that_contradict_the_lock_are_a_fault_after_a_moment(
    bench: Bench, start: IoInputs, changes: dict[str, bool], named: str
) -> None:
    bench.seen = start
    bench.run(0.1)
    assert bench.run(0.06, **changes).lock != "fault"
    state = bench.run(0.2)
    assert (state.lock, bench.outputs.actuator) == ("fault", 0)
    assert named in state.cause


# --- unlocking


def test_a_queue_is_let_go_only_with_confirmation(bench: Bench) -> None:
    bench.to_locked(3)
    assert bench.answer("unlock").reason == "3 trolleys would be released: this needs the operator's confirmation"
    bench.ask("unlock", confirmed=True)
    bench.run(0.1, lock_extended=False)
    assert bench.outputs.actuator == -1
    assert "busy" in bench.answer("lock").reason
    state = bench.run(0.1, lock_retracted=True)
    assert (state.lock, state.queue, bench.outputs.actuator) == ("open", 0, 0)


@pytest.mark.parametrize(
    ("follower", "named"), [(None, "no summary"), (MOVING, "is moving (phase approach)"), (HOLDING, "hold a trolley")]
)
def test_it_does_not_unlock_while_the_follower_moves_or_holds_or_is_not_heard(
    bench: Bench, follower: FollowerSummary | None, named: str
) -> None:
    bench.to_locked()
    bench.follower = follower
    answer = bench.answer("unlock", confirmed=True)
    assert answer.outcome == "refused"
    assert named in answer.reason
    assert bench.outputs.actuator == 0


def test_a_follower_that_begins_to_move_closes_the_lock_again(bench: Bench) -> None:
    bench.to_locked(2)
    asked = bench.ask("unlock", confirmed=True)
    bench.run(0.1, lock_extended=False)
    bench.follower = MOVING
    bench.run(0.02)
    assert bench.outputs.actuator == 1
    assert bench.answers[-1].id == asked
    assert "closing again" in bench.answers[-1].reason
    state = bench.run(0.1, lock_extended=True)
    assert (state.lock, state.queue) == ("locked", 2)


def test_out_of_a_fault_a_switch_that_closes_too_soon_is_no_lock(bench: Bench) -> None:
    bench.seen = HALF_WAY
    bench.run(0.1)
    bench.ask("reset", confirmed=True)
    bench.run(0.1)
    bench.follower = MOVING
    assert bench.run(0.1).lock == "closing"
    state = bench.run(0.1, lock_extended=True)
    assert (state.lock, bench.outputs.actuator) == ("fault", 0)
    assert "before the bolt can have arrived" in state.cause


def test_out_of_a_fault_a_lock_that_closes_again_holds_an_unknown_number(bench: Bench, config: Config) -> None:
    bench.seen = HALF_WAY
    bench.run(0.1)
    bench.ask("reset", confirmed=True)
    bench.run(0.1)
    bench.follower = MOVING
    bench.run(config.leader.lock_travel_least_s + 0.1)
    state = bench.run(0.1, lock_extended=True)
    assert (state.lock, state.queue) == ("locked", None)


def test_what_jams_while_closing_again_is_never_retracted(bench: Bench) -> None:
    bench.to_locked(2)
    bench.ask("unlock", confirmed=True)
    bench.run(0.1, lock_extended=False)
    bench.follower = None
    for _ in range(20):
        assert bench.run(0.2, actuator_current_a=6.0).lock in ("closing", "fault")
        assert bench.outputs.actuator >= 0


def test_a_bolt_half_way_is_retracted_by_a_confirmed_reset_only(bench: Bench) -> None:
    bench.seen = HALF_WAY
    assert bench.run(0.1).lock == "fault"
    assert "confirmation" in bench.answer("reset").reason
    bench.ask("reset", confirmed=True)
    bench.run(0.1)
    assert bench.outputs.actuator == -1
    assert bench.run(0.1, lock_retracted=True).lock == "open"


def test_a_request_that_waited_too_long_is_not_carried_out(bench: Bench) -> None:
    bench.ask("lock", age_ns=6 * NS_PER_S)
    assert bench.run(0.1).lock == "open"
    assert bench.answers[0].outcome == "expired"


# --- queue


def test_a_locked_queue_of_unknown_number_asks_an_operator(config: Config) -> None:
    bench = Bench(config, queue=None, seen=LOCKED)
    assert bench.run(0.1).queue is None
    assert "unknown" in bench.answer("confirm", trolley=3).reason
    assert "confirmation" in bench.answer("count", trolley=2).reason
    assert "contradicts" in bench.answer("count", trolley=0, confirmed=True).reason
    assert bench.answer("count", trolley=2, confirmed=True).outcome == "done"
    assert bench.answer("confirm", trolley=3).outcome == "done"


@pytest.mark.parametrize(("kept", "seen", "queue"), [(5, LOCKED, 5), (0, LOCKED, None), (5, SEATED, 0)])
def test_after_a_start_the_count_must_fit_the_lock(
    config: Config, kept: int, seen: IoInputs, queue: int | None
) -> None:
    assert Bench(config, queue=kept, seen=seen).run(0.1).queue == queue


# --- LEDs


def set_leds(bench: Bench, current_a: float | None, led: int | None = None) -> Answer:
    bench.sequence.led_request(LedRequest(f"led-{bench.now_ns}", 1000, led, current_a), bench.now_ns, bench.now_ns)
    bench.run(0.02)
    return bench.led_answers[-1]


def test_leds_are_on_unasked_and_a_dead_one_is_named(bench: Bench) -> None:
    state = bench.run(0.1)
    assert bench.outputs.led_current_a == (1.0,) * 4
    assert (state.ready, state.led_fault) == (True, False)
    state = bench.run(0.3, led_current_a=(1.0, 1.0, 0.0, 1.0))
    assert not state.led_fault
    state = bench.run(0.5)
    assert state.led_fault
    assert "LED 2 draws 0.00 A" in state.cause


def test_leds_take_the_current_that_is_asked_and_refuse_too_much(bench: Bench) -> None:
    assert set_leds(bench, 0.5, led=1).outcome == "done"
    assert bench.outputs.led_current_a == (1.0, 0.5, 1.0, 1.0)
    assert "exceeds" in set_leds(bench, 2.0).reason
    assert "no LED 7" in set_leds(bench, 0.5, led=7).reason
    assert set_leds(bench, 0.0, led=3).outcome == "done"
    state = bench.run(1.0, led_current_a=(1.0, 0.5, 1.0, 0.0))
    assert (state.led_fault, state.ready) == (False, False)
    assert "LED 3 is switched off" in state.cause
    set_leds(bench, None)
    assert bench.outputs.led_current_a == (1.0,) * 4


def test_a_hot_led_gets_its_rated_current(bench: Bench, config: Config) -> None:
    most, rated = config.leader.led_max_current_a, config.leader.led_rated_current_a
    set_leds(bench, most)
    assert not bench.run(config.leader.led_thermal_s / 4, led_current_a=(most,) * 4).led_derated
    state = bench.run(3 * config.leader.led_thermal_s)
    assert state.led_derated
    assert state.led_setpoint_a == (rated,) * 4
    assert bench.run(10.0, led_current_a=(rated,) * 4).led_derated
    set_leds(bench, None)
    assert bench.outputs.led_current_a == (1.0,) * 4
    assert not bench.run(0.1, led_current_a=(1.0,) * 4).led_derated


def test_with_a_code_the_currents_follow_its_symbols(config: Config) -> None:
    code = LedCodeConfig(number=5)
    bench = Bench(config.model_copy(update={"leds": config.leds.model_copy(update={"code": code})}))
    for _ in range(3 * SYMBOLS):
        expected = level(code.number, code.symbol_ms * NS_PER_MS, code.depth, bench.now_ns + NS_PER_S // 50)
        state = bench.run(0.02, led_current_a=bench.outputs.led_current_a)
        assert bench.outputs.led_current_a == pytest.approx((expected,) * 4)
        assert (state.led_fault, state.ready) == (False, True)


@pytest.mark.parametrize("stuck_a", [0.0, 0.6, 1.0])
def test_a_led_that_is_stuck_at_one_current_has_a_fault_although_a_code_is_shown(
    config: Config, stuck_a: float
) -> None:
    bench = Bench(
        config.model_copy(update={"leds": config.leds.model_copy(update={"code": LedCodeConfig(number=5)})})
    )
    for _ in range(200):
        others = bench.outputs.led_current_a[1:]
        state = bench.run(0.02, led_current_a=(stuck_a, *others))
    assert state.led_fault
    assert "LED 0" in state.cause
