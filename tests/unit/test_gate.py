"""The gate's rules, one by one."""

from __future__ import annotations

from typing import Any

import pytest

from common.messages import Command, seal_command
from common.timing import NS_PER_MS
from follower.can_bridge.gate import ArmToken, Decision, Gate, SignedCommand, StopInputs, WheelStatus
from tests.unit.canbus_rig import stepped_config

CONFIG = stepped_config()
BOOT = "boot"
T0 = 10_000 * NS_PER_MS
CLEAR = StopInputs(fresh=True, estop_clear=True, protective_clear=True)


def command(v: float = 0.3, w: float = 0.0, sequence: int = 1, stamp_ns: int = T0, epoch: int = 7) -> Command:
    return seal_command(Command(v, w, epoch, sequence, stamp_ns, stamp_ns + 120 * NS_PER_MS, 1, stamp_ns))


def signed(sealed: Command, run_id: int = 5, boot_id: str = BOOT) -> SignedCommand:
    return SignedCommand(sealed, run_id, boot_id)


def token(stamp_ns: int = T0, **changes: Any) -> ArmToken:
    fields: dict[str, Any] = {
        "armed": True,
        "stamp_ns": stamp_ns,
        "boot_id": BOOT,
        "epoch": 7,
        "phase": "approach",
        "v_max_m_s": 0.5,
        "w_max_rad_s": 0.6,
    }
    return ArmToken(**{**fields, **changes})


def wheels(v: float, now_ns: int, enabled: bool = True) -> WheelStatus:
    speed = v / CONFIG.base.wheel_radius_m
    return WheelStatus(now_ns, speed, speed, enabled)


class Bench:
    """A gate stepped at 100 Hz; wheels follow at once."""

    def __init__(self) -> None:
        self.gate = Gate(CONFIG.limits, CONFIG.base, BOOT)
        self.now_ns = T0
        self.v = 0.0

    def step(self, newest: SignedCommand | None = None, **given: Any) -> Decision:
        inputs = {
            "token": token(self.now_ns),
            "status": wheels(self.v, self.now_ns),
            "inputs": CLEAR,
            **given,
        }
        decision = self.gate.step(self.now_ns, newest, **inputs)
        self.v = decision.v_m_s
        self.now_ns += 10 * NS_PER_MS
        return decision

    def drive(self, v: float, steps: int, w: float = 0.0, first: int = 1) -> Decision:
        for n in range(steps):
            decision = self.step(signed(command(v, w, first + n, self.now_ns)))
        return decision


def test_ramps_up_to_the_command_and_follows_it() -> None:
    bench = Bench()
    first = bench.drive(0.3, 2)
    assert first.v_m_s == pytest.approx(0.005)
    assert first.clipped == ("rate",)
    last = bench.drive(0.3, 80, first=3)
    assert (last.v_m_s, last.rule, last.clipped) == (0.3, "", ())
    assert last.sequence == 82


@pytest.mark.parametrize(
    ("rule", "given"),
    [
        ("stop_input", {"inputs": StopInputs(False, True, True)}),
        ("stop_input", {"inputs": StopInputs(True, False, True)}),
        ("stop_input", {"inputs": StopInputs(True, True, False)}),
        ("not_armed", {"token": None}),
        ("not_armed", {"token": token(armed=False)}),
        ("not_armed", {"token": token(boot_id="other")}),
        ("token_age", {"token": token(T0 - 1000 * NS_PER_MS)}),
        ("status_age", {"status": wheels(0.1, T0 - 1000 * NS_PER_MS)}),
        ("status_age", {"status": wheels(0.1, -1)}),
        ("not_enabled", {"status": wheels(0.25, T0 + 800 * NS_PER_MS, enabled=False)}),
    ],
)
def test_stops_at_once(rule: str, given: dict[str, Any]) -> None:
    bench = Bench()
    assert bench.drive(0.3, 80).v_m_s == 0.3
    decision = bench.step(None, **given)
    assert (decision.v_m_s, decision.w_rad_s, decision.rule) == (0.0, 0.0, rule)


def test_holds_a_command_for_120_ms_only() -> None:
    bench = Bench()
    bench.drive(0.3, 80)
    for _ in range(11):
        assert bench.step().v_m_s == 0.3
    assert bench.step().rule == ""
    assert bench.step().rule == "command_age"


@pytest.mark.parametrize(
    ("reason", "bad"),
    [
        ("checksum", signed(Command(0.3, 0.0, 7, 99, T0, T0, 1, T0))),
        ("boot", signed(command(sequence=99), boot_id="old")),
        ("epoch", signed(command(sequence=99, epoch=6))),
        ("sequence", signed(command(sequence=3))),
        ("second_writer", signed(command(sequence=99), run_id=6)),
    ],
)
def test_drops_what_is_not_genuine(reason: str, bad: SignedCommand) -> None:
    bench = Bench()
    bench.drive(0.3, 10)
    decision = bench.step(bad)
    assert decision.dropped == reason
    assert decision.sequence == 10


def test_a_second_writer_stops_until_the_next_epoch() -> None:
    bench = Bench()
    bench.drive(0.3, 10)
    bench.step(signed(command(sequence=50, stamp_ns=bench.now_ns), run_id=6))
    assert bench.step(signed(command(sequence=51, stamp_ns=bench.now_ns))).rule == "second_writer"
    fresh = token(bench.now_ns, epoch=8)
    decision = bench.step(signed(command(sequence=1, stamp_ns=bench.now_ns, epoch=8), run_id=6), token=fresh)
    assert decision.rule == ""


def test_caps_keep_the_curvature() -> None:
    bench = Bench()
    for n in range(200):
        given = token(bench.now_ns, v_max_m_s=0.1)
        decision = bench.step(signed(command(0.4, 0.2, n, bench.now_ns)), token=given)
    assert decision.v_m_s == pytest.approx(0.1)
    assert decision.w_rad_s == pytest.approx(0.05)
    assert decision.clipped == ("cap",)


def test_wheels_that_do_not_follow_stop_it() -> None:
    bench = Bench()
    for n in range(60):
        still = wheels(0.0, bench.now_ns)
        decision = bench.step(signed(command(0.5, 0.0, n, bench.now_ns)), status=still)
    assert decision.rule == "measured_gap"
    assert decision.v_m_s == 0.0


def test_an_encoder_jump_stops_it() -> None:
    bench = Bench()
    bench.drive(0.2, 60)
    decision = bench.step(status=wheels(-0.2, bench.now_ns))
    assert decision.rule == "measured_jump"
