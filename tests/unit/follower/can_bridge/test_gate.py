"""The gate's rules, one by one, each at its edge."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from common.ceilings import PHASE_CAPS
from common.config import BaseConfig, LimitsConfig
from common.messages import PHASES, Command, Phase, seal_command
from follower.can_bridge.gate import ArmToken, Decision, Gate, StampedCommand, StopInputs, WheelStatus, _beyond

MS = 1_000_000
BOOT = "boot"
T0 = 10_000 * MS
RADIUS, TRACK = 0.085, 0.5
BASE = BaseConfig(wheel_radius_m=RADIUS, track_m=TRACK, latency_ms=20.0)
LIMITS = LimitsConfig(
    v_min_m_s=-0.1,
    v_max_m_s=0.5,
    w_max_rad_s=0.6,
    controller_dv_m_s=0.02,
    controller_dw_rad_s=0.08,
    gate_acceleration_m_s2=0.5,
    gate_angular_acceleration_rad_s2=2.0,
)
CLEAR = StopInputs(fresh=True, estop_clear=True, protective_clear=True)


def command(v: float = 0.3, w: float = 0.0, sequence: int = 1, stamp_ns: int = T0, epoch: int = 7) -> Command:
    return seal_command(Command(v, w, epoch, sequence, stamp_ns, stamp_ns + 500 * MS, 1, stamp_ns))


def stamped(sealed: Command, run_id: int = 5, boot_id: str = BOOT) -> StampedCommand:
    return StampedCommand(command=sealed, run_id=run_id, boot_id=boot_id)


def token(stamp_ns: int = T0, **changes: Any) -> ArmToken:
    return replace(
        ArmToken(
            armed=True, stamp_ns=stamp_ns, boot_id=BOOT, epoch=7, phase="approach", v_max_m_s=0.5, w_max_rad_s=0.6
        ),
        **changes,
    )


def wheels(v: float, now_ns: int, w: float = 0.0, drives_enabled: bool = True) -> WheelStatus:
    turn = w * TRACK / 2
    return surfaces(v - turn, v + turn, now_ns, drives_enabled)


def surfaces(left_m_s: float, right_m_s: float, now_ns: int, drives_enabled: bool = True) -> WheelStatus:
    """Measured surface speeds, at angle 0."""
    return WheelStatus(
        measured_ns=now_ns,
        left_rad_s=left_m_s / RADIUS,
        right_rad_s=right_m_s / RADIUS,
        left_rad=0.0,
        right_rad=0.0,
        drives_enabled=drives_enabled,
    )


class Bench:
    """A gate stepped at 100 Hz; wheels follow at once."""

    def __init__(self, limits: LimitsConfig = LIMITS, **standing: Any) -> None:
        self.gate = Gate(limits, BASE, BOOT)
        self.now_ns = T0
        self.v = self.w = 0.0
        self.sequence = 0
        self.standing = standing

    def step(self, newest: StampedCommand | None = None, period_ms: float = 10.0, **given: Any) -> Decision:
        inputs = {
            "token": token(self.now_ns, **self.standing),
            "status": wheels(self.v, self.now_ns, self.w),
            "inputs": CLEAR,
            **given,
        }
        decision = self.gate.step(self.now_ns, newest, **inputs)
        self.v, self.w = decision.v_m_s, decision.w_rad_s
        self.now_ns += round(period_ms * MS)
        return decision

    def order(self, v: float, w: float = 0.0, **given: Any) -> Decision:
        """One step with a new command."""
        self.sequence += 1
        return self.step(stamped(command(v, w, self.sequence, self.now_ns)), **given)

    def drive(self, v: float, w: float = 0.0, steps: int = 100) -> Decision:
        for _ in range(steps - 1):
            self.order(v, w)
        return self.order(v, w)


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


@pytest.mark.parametrize("beyond", [-1e-6, 1e-6])
@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_an_encoder_jump_stops_it(beyond: float, side: int, direction: float) -> None:
    bench = Bench()
    bench.drive(0.2)
    speeds = [0.2, 0.2]
    speeds[side] += direction * (0.30 + beyond)
    decision = bench.step(status=surfaces(speeds[0], speeds[1], bench.now_ns))
    assert (decision.rule == "measured_jump") == (beyond > 0)


@pytest.mark.parametrize("beyond", [-1e-6, 1e-6])
@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_an_angle_that_jumps_stops_it_however_steady_the_speed(beyond: float, side: int, direction: float) -> None:
    bench = Bench()
    bench.drive(0.2)
    before = [1.0, -2.0]
    bench.now_ns += 41 * MS  # too long ago for the angles to be compared
    bench.order(0.2, status=replace(wheels(0.2, bench.now_ns), left_rad=before[0], right_rad=before[1]))
    before[side] += direction * (0.05 + beyond) / RADIUS
    decision = bench.order(0.2, status=replace(wheels(0.2, bench.now_ns), left_rad=before[0], right_rad=before[1]))
    assert (decision.rule == "measured_jump") == (beyond > 0)


@pytest.mark.parametrize("beyond", [False, True])
@pytest.mark.parametrize(("field", "bound"), [("left_rad_s", 0.30), ("right_rad", 0.05)])
def test_a_jump_of_exactly_the_bound_is_accepted(field: str, bound: float, beyond: bool) -> None:
    gate = Gate(LIMITS, BASE, BOOT)
    gate.step(T0, None, token(T0), wheels(0.0, T0), CLEAR)
    step = bound / RADIUS
    assert step * RADIUS == bound
    later = T0 + 10 * MS
    changed: dict[str, Any] = {field: step + 1e-12 if beyond else step}
    status = replace(wheels(0.0, later), **changed)
    newest = stamped(command(stamp_ns=later))
    assert gate.step(later, newest, token(later), status, CLEAR).rule == ("measured_jump" if beyond else "")


def test_a_jump_counts_only_between_two_recent_measurements() -> None:
    bench = Bench()
    bench.step(status=wheels(0.0, -1))
    assert bench.order(0.1, status=wheels(0.5, bench.now_ns)).rule == ""
    before_ns = bench.now_ns - 10 * MS
    for gap_ms, rule in ((50, "measured_jump"), (51, "")):
        gate = Gate(LIMITS, BASE, BOOT)
        gate.step(before_ns, None, token(before_ns), wheels(0.0, before_ns), CLEAR)
        now_ns = before_ns + gap_ms * MS
        newest = stamped(command(stamp_ns=now_ns))
        assert gate.step(now_ns, newest, token(now_ns), wheels(0.5, now_ns), CLEAR).rule == rule


@pytest.mark.parametrize("second_ns", [0, 10 * MS])
def test_a_jump_is_seen_from_time_zero_on(second_ns: int) -> None:
    gate = Gate(LIMITS, BASE, BOOT)
    gate.step(0, stamped(command(stamp_ns=0)), token(0), wheels(0.0, 0), CLEAR)
    assert gate.step(second_ns, None, token(0), wheels(0.5, second_ns), CLEAR).rule == "measured_jump"


def test_a_jump_to_never_measured_is_an_old_status() -> None:
    bench = Bench()
    bench.drive(0.2)
    assert bench.step(status=wheels(0.9, -1)).rule == "status_age"
    assert bench.order(0.2).rule == ""


@pytest.mark.parametrize("beyond", [-1e-6, 1e-6])
@pytest.mark.parametrize(("v", "w"), [(0.3, 0.0), (-0.1, 0.0), (0.1, 0.6), (0.1, -0.6)])
@pytest.mark.parametrize("side", [0, 1])
def test_wheels_that_do_not_follow_stop_it(v: float, w: float, side: int, beyond: float) -> None:
    bench = Bench(replace_limits(w_max_rad_s=0.8), w_max_rad_s=0.8)
    bench.drive(v, w)
    turn = w * TRACK / 2
    speeds = [v - turn, v + turn]
    set_m_s = speeds[side]
    speeds[side] -= math.copysign(0.15 + 0.2 * abs(set_m_s) + beyond, set_m_s)
    decision = bench.order(
        v,
        w,
        status=surfaces(speeds[0], speeds[1], bench.now_ns),
    )
    assert (decision.rule == "measured_gap") == (beyond > 0)


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("v", [0.05, -0.05])
@pytest.mark.parametrize("share", [0.24, 0.26, -1.0])
def test_a_wheel_that_hardly_rolls_at_docking_speed_stops_it_after_300_ms(side: int, v: float, share: float) -> None:
    bench = Bench()
    bench.drive(v)
    speeds = [v, v]
    speeds[side] = share * v
    found, began_ns = [], bench.now_ns
    for _ in range(40):
        status = surfaces(speeds[0], speeds[1], bench.now_ns)
        found.append((bench.now_ns - began_ns, bench.order(v, status=status).rule))
    stopped = [after_ns for after_ns, rule in found if rule]
    assert stopped[:1] == ([] if share > 0.25 else [310 * MS])


def test_time_without_a_setpoint_for_a_wheel_does_not_count() -> None:
    bench = Bench()
    for v in (0.1, 0.0, -0.1, 0.0) * 4:
        for _ in range(28):
            assert bench.order(v, status=wheels(0.0, bench.now_ns)).rule == ""


def test_wheels_that_run_ahead_of_a_slower_setpoint_do_not_stop_it() -> None:
    bench = Bench()
    bench.drive(0.2)
    for ahead in (0.4, -0.4 + 0.6):
        assert bench.order(0.2, status=wheels(ahead, bench.now_ns)).rule == ""
    bench = Bench()
    assert bench.order(0.0, status=wheels(0.5, bench.now_ns)).rule == ""
    assert bench.order(0.0, status=wheels(0.5, bench.now_ns)).rule == ""
    assert bench.order(-0.0, status=wheels(0.3, bench.now_ns)).rule == ""


def test_a_cap_scales_both_and_keeps_the_curvature() -> None:
    bench = Bench(v_max_m_s=0.1)
    decision = bench.drive(0.4, 0.2)
    assert decision.v_m_s == pytest.approx(0.1)
    assert decision.w_rad_s == pytest.approx(0.05)
    assert decision.clipped == ("cap",)


def test_a_lowered_cap_holds_at_once() -> None:
    bench = Bench()
    bench.drive(0.4, 0.2)
    bench.standing = {"v_max_m_s": 0.1}
    decision = bench.order(0.4, 0.2)
    assert decision.v_m_s == pytest.approx(0.1)
    assert decision.w_rad_s == pytest.approx(0.05)
    assert decision.clipped == ("cap", "rate")


def replace_limits(**changes: float) -> LimitsConfig:
    return LIMITS.model_copy(update=changes)


@pytest.mark.parametrize(
    ("v", "w", "cap", "expected"),
    [
        (9.0, 0.0, {}, (0.5, 0.0)),
        (-9.0, 0.0, {}, (-0.1, 0.0)),
        (0.0, 9.0, {}, (0.0, 0.6)),
        (0.0, -9.0, {}, (0.0, -0.6)),
        (0.0, 9.0, {"w_max_rad_s": 0.2}, (0.0, 0.2)),
        (-9.0, 0.0, {"v_max_m_s": 0.05}, (-0.05, 0.0)),
        (0.5, 0.6, {}, (0.5 * 0.6 / 0.65, 0.6 * 0.6 / 0.65)),
        (0.5, -0.6, {}, (0.5 * 0.6 / 0.65, -0.6 * 0.6 / 0.65)),
    ],
)
def test_caps_of_configuration_mission_and_wheels(
    v: float, w: float, cap: dict[str, Any], expected: tuple[float, float]
) -> None:
    decision = Bench(**cap).drive(v, w, steps=300)
    assert (decision.v_m_s, decision.w_rad_s) == pytest.approx(expected)


def test_constants_in_code_stand_above_the_configuration() -> None:
    loose = LIMITS.model_copy(
        update={
            "v_max_m_s": 5.0,
            "v_min_m_s": -5.0,
            "w_max_rad_s": 5.0,
            "gate_acceleration_m_s2": 50.0,
            "gate_angular_acceleration_rad_s2": 50.0,
        }
    )
    far = {"v_max_m_s": 9.0, "w_max_rad_s": 9.0}
    bench = Bench(loose, **far)
    bench.order(9.0)
    assert bench.order(9.0).v_m_s == pytest.approx(0.006)
    assert bench.drive(9.0, steps=200).v_m_s == pytest.approx(0.6)
    assert Bench(loose, **far).drive(-9.0, steps=200).v_m_s == pytest.approx(-0.2)
    turning = Bench(loose, **far)
    turning.order(0.0, 9.0)
    assert turning.order(0.0, 9.0).w_rad_s == pytest.approx(0.025)
    assert turning.drive(0.0, 9.0, steps=200).w_rad_s == pytest.approx(0.8)


def test_configuration_lowers_the_caps() -> None:
    low = replace_limits(v_max_m_s=0.3, v_min_m_s=-0.05, w_max_rad_s=0.4)
    far = {"v_max_m_s": 9.0, "w_max_rad_s": 9.0}
    assert Bench(low, **far).drive(9.0, steps=200).v_m_s == pytest.approx(0.3)
    assert Bench(low, **far).drive(-9.0, steps=200).v_m_s == pytest.approx(-0.05)
    assert Bench(low, **far).drive(0.0, 9.0, steps=200).w_rad_s == pytest.approx(0.4)
    slow = Bench(replace_limits(gate_acceleration_m_s2=0.1, gate_angular_acceleration_rad_s2=0.5))
    slow.order(0.3)
    assert slow.order(0.3).v_m_s == pytest.approx(0.001)
    turning = Bench(replace_limits(gate_acceleration_m_s2=0.1, gate_angular_acceleration_rad_s2=0.5))
    turning.order(0.0, 0.3)
    assert turning.order(0.0, 0.3).w_rad_s == pytest.approx(0.005)


def test_a_gap_of_exactly_the_bound_is_accepted() -> None:
    assert not _beyond(0.5, 0.25)
    assert not _beyond(-0.5, -0.25)
    assert not _beyond(0.0, -9.0)


@pytest.mark.parametrize("phase", PHASES)
def test_each_phase_is_held_to_its_cap(phase: Phase) -> None:
    cap = PHASE_CAPS[phase]
    loose = {"v_max_m_s": 9.0, "w_max_rad_s": 9.0, "phase": phase}
    wide = replace_limits(v_max_m_s=0.6, w_max_rad_s=0.8)
    assert Bench(wide, **loose).drive(9.0, steps=200).v_m_s == pytest.approx(cap.v_m_s)
    assert Bench(wide, **loose).drive(0.0, 9.0, steps=200).w_rad_s == pytest.approx(cap.w_rad_s)
    both = Bench(wide, **loose).drive(cap.v_m_s, cap.w_rad_s, steps=200)
    back = Bench(replace_limits(v_min_m_s=-0.2, w_max_rad_s=0.8), **loose).drive(-0.05, cap.w_rad_s, steps=200)
    assert abs(back.v_m_s) + abs(back.w_rad_s) * TRACK / 2 <= cap.wheel_m_s + 1e-9
    wheel_m_s = abs(both.v_m_s) + abs(both.w_rad_s) * TRACK / 2
    assert wheel_m_s == pytest.approx(min(cap.wheel_m_s, cap.v_m_s + cap.w_rad_s * TRACK / 2))


def test_an_unknown_phase_stands_still() -> None:
    assert Bench(phase="party").drive(0.3).v_m_s == 0.0


def test_a_stall_allows_no_larger_step() -> None:
    bench = Bench()
    bench.order(0.3)
    bench.order(0.3, period_ms=15.0)
    assert bench.order(0.3, period_ms=3000.0).v_m_s == pytest.approx(0.005 + 0.0075)
    assert bench.order(0.3).v_m_s == pytest.approx(0.0125 + 0.01)


def test_a_clock_that_goes_back_allows_no_step() -> None:
    bench = Bench()
    bench.order(0.3)
    before = bench.order(0.3, period_ms=-1.0)
    assert bench.order(0.3, status=wheels(0.0, bench.now_ns)).v_m_s == before.v_m_s


@pytest.mark.parametrize(
    ("v", "w", "reach"), [(0.5, 0.0, 0.125), (-0.1, 0.0, 0.06), (0.0, 0.6, 0.5), (0.0, -0.6, 0.5)]
)
def test_the_window_holds_when_time_itself_is_wrong(v: float, w: float, reach: float) -> None:
    """A clock that swings to and fro gains rate for nothing; 250 real ms allow no more than they should."""
    limits = replace_limits(gate_acceleration_m_s2=0.24) if v < 0 else LIMITS
    bench = Bench(limits)
    clipped: set[str] = set()
    for n in range(100):
        decision = bench.order(v, w, period_ms=10.0 if n % 2 else -10.0)
        clipped.update(decision.clipped)
    assert abs(decision.v_m_s) + abs(decision.w_rad_s) == pytest.approx(reach)
    assert "window" in clipped


def test_the_window_slides_and_forgets() -> None:
    bench = Bench()
    for n in range(100):
        bench.order(0.5, period_ms=10.0 if n % 2 else -10.0)
    assert bench.v == pytest.approx(0.125)
    swung_ns = bench.now_ns
    bench.now_ns = swung_ns + 250 * MS
    assert bench.order(0.5).clipped == ("rate", "window")
    bench.now_ns = swung_ns + 250 * MS + 20 * MS
    assert "window" not in bench.order(0.5).clipped


def test_slowing_down_is_free_in_the_window_and_reversing_is_not() -> None:
    bench = Bench()
    bench.drive(0.5)
    bench.step(token=None, status=wheels(0.5, bench.now_ns))
    ramped = [bench.order(0.5, status=wheels(0.5 - 0.005 * n, bench.now_ns)).v_m_s for n in range(10)]
    assert ramped[-1] == pytest.approx(0.05)
    bench = Bench()
    bench.drive(0.3)
    assert bench.drive(0.0, steps=70).v_m_s == 0.0
    assert bench.drive(-0.1, steps=30).v_m_s == pytest.approx(-0.1)


def test_decision_keeps_no_memory_of_old_windows() -> None:
    gate = Gate(LIMITS, BASE, BOOT)
    for n in range(400):
        gate.step(T0, stamped(command(0.3, sequence=n)), token(), wheels(0.0, T0), CLEAR)
    assert len(gate._window) <= 128
