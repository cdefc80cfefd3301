"""The operator of a soak: a docking a minute, three tries, and an end to everything."""

from __future__ import annotations

from typing import Any

from experiments.shared.operator import PERIOD_S, Operator


class Reported:
    """A mission or a Leader's state, as far as the operator looks."""

    def __init__(self, **fields: Any) -> None:
        vars(self).update(fields)


def mission(phase: str, trolley: int = 1, cause: str = "") -> Any:
    return Reported(phase=phase, trolley=trolley, cause=cause)


def begun(operator: Operator, now_s: float) -> None:
    assert operator.step(now_s, mission("idle"), None) == "start"
    operator.answered(now_s, "start", accepted=True)


def test_the_next_trolley_is_asked_for_a_minute_after_the_last() -> None:
    operator = Operator()
    begun(operator, 0.0)
    assert operator.step(30.0, mission("approach"), None) is None
    assert operator.step(40.0, mission("done"), None) is None
    assert operator.trolley == 2
    assert operator.step(PERIOD_S - 1, mission("done"), None) is None
    assert operator.step(PERIOD_S, mission("done"), None) == "start"
    assert operator.ends == {"done": 1}


def test_three_tries_then_it_is_given_up() -> None:
    operator = Operator()
    for k in range(3):
        begun(operator, 100.0 * k)
        assert operator.step(100.0 * k + 10, mission("aborted", cause="slip"), None) is None
    assert operator.given_up == "trolley 1: slip"
    assert operator.step(500.0, mission("aborted"), None) is None


def test_an_aborted_docking_is_reset_and_a_trolley_that_is_counted_is_not_docked_again() -> None:
    operator = Operator()
    begun(operator, 0.0)
    assert operator.step(30.0, mission("aborted", cause="gate_stop"), Reported(queue=1)) is None  # type: ignore[arg-type]
    assert operator.trolley == 2
    assert operator.step(PERIOD_S, mission("aborted"), None) == "reset"


def test_a_docking_that_never_ends_is_ended_without_a_name() -> None:
    operator = Operator()
    begun(operator, 0.0)
    assert operator.step(300.0, mission("approach"), None) is None
    assert operator.ends == {"not ended by name": 1}
