"""The gate's rules, one by one, each at its edge."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from common.messages import Command, seal_command
from follower.can_bridge.gate import (
    Gate,
    StampedCommand,
    StopInputs,
)
from tests.rigs.gate_rig import (
    BASE,
    BOOT,
    CLEAR,
    LIMITS,
    MS,
    T0,
    Bench,
    command,
    stamped,
    token,
    wheels,
)


def test_ramps_up_to_the_command_and_follows_it() -> None:
    bench = Bench()
    first = bench.order(0.3)
    assert (first.v_m_s, first.rule, first.clipped) == (0.0, "", ("rate",))
    second = bench.order(0.3)
    assert second.v_m_s == pytest.approx(0.005)
    last = bench.drive(0.3, steps=80)
    assert (last.v_m_s, last.rule, last.clipped, last.dropped, last.sequence) == (0.3, "", (), "", 82)


def test_a_command_to_stand_is_obeyed_at_once_and_any_other_at_its_rate() -> None:
    bench = Bench()
    bench.drive(0.3, 0.2)
    assert bench.order(0.0, 0.2).v_m_s > 0.29
    assert bench.order(0.3, 0.0).w_rad_s > 0.1
    stood = bench.order(0.0, 0.0)
    assert (stood.v_m_s, stood.w_rad_s, stood.rule, stood.clipped) == (0.0, 0.0, "", ())


def test_turns_at_its_own_rate() -> None:
    bench = Bench()
    bench.order(0.0, 0.5)
    assert bench.order(0.0, 0.5).w_rad_s == pytest.approx(0.02)
    assert bench.drive(0.0, 0.5, steps=40).w_rad_s == 0.5
    assert bench.order(0.0, -0.5).w_rad_s == pytest.approx(0.48)


def test_both_grow_together() -> None:
    bench = Bench()
    bench.order(0.4, 0.1)
    for _ in range(20):
        decision = bench.order(0.4, 0.1)
        assert decision.w_rad_s == pytest.approx(decision.v_m_s / 4)


@pytest.mark.parametrize(
    ("rule", "given"),
    [
        ("stop_input", {"inputs": StopInputs(fresh=False, estop_clear=True, protective_clear=True)}),
        ("stop_input", {"inputs": StopInputs(fresh=True, estop_clear=False, protective_clear=True)}),
        ("stop_input", {"inputs": StopInputs(fresh=True, estop_clear=True, protective_clear=False)}),
        ("not_armed", {"token": None}),
        ("not_armed", {"token": token(armed=False)}),
        ("not_armed", {"token": token(boot_id="other")}),
        ("token_caps", {"token": token(T0 + 1000 * MS, v_max_m_s=math.nan)}),
        ("token_caps", {"token": token(T0 + 1000 * MS, w_max_rad_s=math.nan)}),
        ("token_caps", {"token": token(T0 + 1000 * MS, v_max_m_s=-0.1)}),
        ("token_caps", {"token": token(T0 + 1000 * MS, w_max_rad_s=-0.1)}),
        ("status_age", {"status": wheels(0.3, -1)}),
        ("not_enabled", {"status": wheels(0.3, T0 + 1000 * MS, drives_enabled=False)}),
        (
            "measured_jump",
            {"status": replace(wheels(0.3, T0 + 1000 * MS), left_rad_s=math.nan)},
        ),
        (
            "measured_jump",
            {"status": replace(wheels(0.3, T0 + 1000 * MS), right_rad_s=math.inf)},
        ),
        (
            "measured_jump",
            {"status": replace(wheels(0.3, T0 + 1000 * MS), left_rad=math.nan)},
        ),
        (
            "measured_jump",
            {"status": replace(wheels(0.3, T0 + 1000 * MS), right_rad=-math.inf)},
        ),
    ],
)
def test_stops_at_once(rule: str, given: dict[str, Any]) -> None:
    bench = Bench()
    assert bench.drive(0.3).v_m_s == 0.3
    decision = bench.step(**given)
    assert (decision.v_m_s, decision.w_rad_s, decision.rule) == (0.0, 0.0, rule)


def test_a_cap_of_zero_is_a_cap() -> None:
    bench = Bench(v_max_m_s=0.0, w_max_rad_s=0.0)
    decision = bench.drive(0.3, 0.3)
    assert (decision.v_m_s, decision.w_rad_s, decision.rule) == (0.0, 0.0, "")


@pytest.mark.parametrize(
    ("rule", "limit_ms"), [("command_age", 120), ("token_age", 200), ("status_age", 50), ("valid_until", 60)]
)
@pytest.mark.parametrize("beyond_ns", [0, 1])
def test_ages_to_the_nanosecond(rule: str, limit_ms: int, beyond_ns: int) -> None:
    bench = Bench()
    bench.drive(0.2)
    now_ns = bench.now_ns
    old_ns = now_ns - limit_ms * MS - beyond_ns
    fresh = command(0.2, sequence=200, stamp_ns=now_ns)
    given: dict[str, Any] = {}
    if rule == "command_age":
        fresh = command(0.2, sequence=200, stamp_ns=old_ns)
    elif rule == "valid_until":
        fresh = seal_command(replace(fresh, valid_until_ns=now_ns - beyond_ns))
    elif rule == "token_age":
        given["token"] = token(old_ns)
    else:
        given["status"] = wheels(0.2, old_ns)
    decision = bench.step(stamped(fresh), **given)
    assert decision.rule == (rule if beyond_ns else "")
    assert decision.v_m_s == pytest.approx(0.0 if beyond_ns else 0.2)


@pytest.mark.parametrize("rule", ["command_age", "token_age", "status_age"])
def test_a_stamp_from_the_future_is_not_fresh(rule: str) -> None:
    bench = Bench()
    bench.drive(0.2)
    future_ns = bench.now_ns + 1
    newest = stamped(command(0.2, sequence=200, stamp_ns=future_ns if rule == "command_age" else bench.now_ns))
    given: dict[str, Any] = {}
    if rule == "token_age":
        given["token"] = token(future_ns)
    elif rule == "status_age":
        given["status"] = wheels(0.2, future_ns)
    assert bench.step(newest, **given).rule == rule


def test_status_of_time_zero_is_a_status() -> None:
    gate = Gate(LIMITS, BASE, BOOT)
    first = command(0.2, stamp_ns=0)
    for now_ns in (0, 10 * MS):
        decision = gate.step(now_ns, stamped(first), token(0), wheels(0.0, 0), CLEAR)
    assert decision.rule == ""
    assert decision.v_m_s > 0.0


def test_nothing_moves_before_a_command_and_after_disarming() -> None:
    bench = Bench()
    assert bench.step().rule == "no_command"
    bench.drive(0.3)
    assert bench.step(token=token(bench.now_ns, armed=False)).rule == "not_armed"
    again = bench.step()
    assert again.rule == ""
    assert again.v_m_s == pytest.approx(0.005)


def tampered(**changes: Any) -> Command:
    """A command whose fields were changed after it was sealed."""
    changed = command(sequence=99)
    for name, value in changes.items():
        object.__setattr__(changed, name, value)
    return changed


@pytest.mark.parametrize(
    ("reason", "bad"),
    [
        ("checksum", stamped(tampered(v_m_s=0.31))),
        ("not_finite", stamped(tampered(v_m_s=math.nan))),
        ("not_finite", stamped(tampered(w_rad_s=math.inf))),
        ("boot", stamped(command(sequence=99), boot_id="old")),
        ("epoch", stamped(command(sequence=99, epoch=6))),
        ("epoch", stamped(command(sequence=99, epoch=8))),
        ("sequence", stamped(command(sequence=100))),
        ("sequence", stamped(command(sequence=3))),
        ("second_writer", stamped(command(sequence=199), run_id=6)),
    ],
)
def test_drops_what_is_not_genuine(reason: str, bad: StampedCommand) -> None:
    bench = Bench()
    bench.drive(0.3)
    decision = bench.step(bad)
    assert (decision.dropped, decision.sequence) == (reason, 100)
    assert bench.step().v_m_s == (0.0 if reason == "second_writer" else 0.3)


def test_a_command_before_arming_is_dropped() -> None:
    bench = Bench()
    early = stamped(command(stamp_ns=bench.now_ns))
    assert bench.step(early, token=None).dropped == "not_armed"
    assert bench.step(early, token=token(bench.now_ns, armed=False)).dropped == "not_armed"
    assert bench.step(early).dropped == ""


def test_the_same_command_again_is_not_a_new_one() -> None:
    bench = Bench()
    held = stamped(command(0.1, sequence=4, stamp_ns=bench.now_ns))
    for _ in range(12):
        decision = bench.step(held)
        assert (decision.dropped, decision.rule, decision.sequence) == ("", "", 4)


def test_the_first_sequence_may_be_zero_and_each_epoch_counts_again() -> None:
    bench = Bench()
    assert bench.step(stamped(command(0.3, sequence=0, stamp_ns=bench.now_ns))).sequence == 0
    bench.step(stamped(command(0.3, sequence=50, stamp_ns=bench.now_ns)))
    renewed = bench.step(token=token(bench.now_ns, epoch=8))
    assert (renewed.rule, renewed.sequence, renewed.v_m_s) == ("no_command", -1, 0.0)
    other = stamped(command(0.3, sequence=0, stamp_ns=bench.now_ns, epoch=8), run_id=6)
    accepted = bench.step(other, token=token(bench.now_ns, epoch=8))
    assert (accepted.rule, accepted.dropped, accepted.sequence) == ("", "", 0)


def test_an_epoch_of_zero_is_an_epoch() -> None:
    bench = Bench(epoch=0)
    bench.step(stamped(command(0.1, sequence=5, stamp_ns=bench.now_ns, epoch=0)))
    later = stamped(command(0.1, sequence=4, stamp_ns=bench.now_ns, epoch=0))
    assert bench.step(later).dropped == "sequence"


@pytest.mark.parametrize("rule", ["second_writer", "measured_jump", "measured_gap", "measured_stuck"])
def test_latches_until_the_next_epoch(rule: str) -> None:
    bench = Bench()
    bench.drive(0.3)
    if rule == "second_writer":
        found = bench.step(stamped(command(sequence=500, stamp_ns=bench.now_ns), run_id=6))
    elif rule == "measured_jump":
        found = bench.step(status=wheels(-0.1, bench.now_ns))
    elif rule == "measured_stuck":
        bench.drive(0.0)
        for _ in range(40):
            found = bench.order(0.1, status=wheels(0.0, bench.now_ns))
            if found.rule:
                break
    else:
        for v in (0.2, 0.1, 0.05):
            found = bench.order(0.3, status=wheels(v, bench.now_ns))
    assert (found.rule, found.v_m_s, found.w_rad_s) == (rule, 0.0, 0.0)
    for _ in range(3):
        assert bench.order(0.3).rule == rule
    assert bench.step(token=None).rule == "not_armed"
    assert bench.order(0.3).rule == rule
    bench.standing = {"epoch": 8}
    fresh = stamped(command(sequence=1, stamp_ns=bench.now_ns, epoch=8), run_id=6)
    assert bench.step(fresh).rule == ""


def test_a_jump_before_the_first_mission_latches_until_it() -> None:
    bench = Bench(epoch=1)
    before = bench.step(
        token=None,
        status=replace(wheels(0.0, T0), left_rad_s=math.nan),
    )
    assert (before.rule, before.sequence) == ("not_armed", -1)
    assert bench.step(stamped(command(sequence=0, stamp_ns=bench.now_ns, epoch=1))).rule == ""


def test_a_jump_under_a_stop_input_is_not_forgotten() -> None:
    bench = Bench()
    bench.drive(0.3)
    pressed = StopInputs(fresh=True, estop_clear=False, protective_clear=True)
    assert bench.step(inputs=pressed, status=wheels(-0.1, bench.now_ns)).rule == "stop_input"
    assert bench.order(0.3).rule == "measured_jump"


def test_the_first_latched_rule_is_the_one_that_is_reported() -> None:
    bench = Bench()
    bench.drive(0.3)
    bench.step(stamped(command(sequence=500, stamp_ns=bench.now_ns), run_id=6))
    bench.step(status=replace(wheels(0.0, bench.now_ns), left_rad_s=math.nan))
    bench.step()
    assert bench.step().rule == "second_writer"
