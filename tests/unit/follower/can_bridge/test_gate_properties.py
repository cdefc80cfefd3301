"""What must hold at every step of the gate, over a million random steps and over Hypothesis' worst ideas."""

from __future__ import annotations

import math
import os

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from common.messages import PHASES, Command, Phase, seal_command
from follower.can_bridge.gate import ArmToken, Gate, StampedCommand, StopInputs, WheelStatus
from tests.rigs.gate_rig import BASE, BOOT, LIMITS, MS
from tests.rigs.gate_walk import EPS, Walk

SHARDS = 8
STEPS = int(os.environ.get("GATE_STEPS", "200000")) // SHARDS
"""`make prove` walks the million; one `make test` a fifth of it."""


@pytest.mark.parametrize("seed", range(SHARDS))
def test_a_random_walk_breaks_no_invariant(seed: int) -> None:
    walk = Walk(seed)
    rules: set[str] = set()
    for _ in range(STEPS):
        decision = walk.step()
        rules.update((decision.rule, decision.dropped, *decision.clipped))
    assert walk.moved > STEPS // 10
    assert {"stop_input", "status_age", "token_age", "token_caps", "command_age", "cap", "rate"} <= rules


moments = st.integers(0, 400)
steps = st.lists(
    st.fixed_dictionaries(
        {
            "after_ms": st.integers(-20, 300),
            "v": st.floats(-10.0, 10.0),
            "w": st.floats(-10.0, 10.0),
            "sequence": st.integers(0, 12),
            "command_epoch": st.integers(0, 2),
            "command_age_ms": st.integers(-50, 300),
            "run_id": st.integers(5, 6),
            "token_epoch": st.integers(0, 2),
            "token_age_ms": st.integers(-50, 400),
            "armed": st.booleans(),
            "cap": st.sampled_from((0.0, 0.05, 0.5, 9.0, math.nan, math.inf, -1.0)),
            "phase": st.sampled_from(("approach", "approach", "approach", "push", "idle")),
            "status_age_ms": st.integers(-50, 100),
            "surfaces_m_s": st.tuples(*[st.floats(-1.0, 1.0) | st.sampled_from((0.0, math.nan, math.inf))] * 2),
            "follow": st.booleans(),
            "inputs": st.tuples(*[st.integers(0, 9).map(bool)] * 3),
        }
    ),
    min_size=1,
    max_size=5,
)


@settings(max_examples=2000, deadline=None, suppress_health_check=list(HealthCheck))
@given(steps)
def test_no_sequence_of_inputs_moves_the_wheels_against_the_rules(given_steps: list[dict[str, object]]) -> None:
    gate, now_ns, last_v, last_w = _under_way()
    for step in given_steps:
        given_step: dict[str, object] = step
        after_ms = _int(given_step["after_ms"])
        now_ns += after_ms * MS
        stamp = now_ns - _int(given_step["command_age_ms"]) * MS
        command = seal_command(
            Command(
                _float(given_step["v"]),
                _float(given_step["w"]),
                _int(given_step["command_epoch"]),
                _int(given_step["sequence"]),
                stamp,
                stamp + 120 * MS,
                1,
                stamp,
            )
        )
        cap = _float(given_step["cap"])
        token_ns = now_ns - _int(given_step["token_age_ms"]) * MS
        phase: Phase = next(known for known in PHASES if known == given_step["phase"])
        token = ArmToken(
            armed=bool(given_step["armed"]),
            stamp_ns=token_ns,
            boot_id=BOOT,
            epoch=_int(given_step["token_epoch"]),
            phase=phase,
            v_max_m_s=cap,
            w_max_rad_s=cap,
        )
        surfaces_m_s = (last_v, last_v) if given_step["follow"] else given_step["surfaces_m_s"]
        assert isinstance(surfaces_m_s, tuple)
        radius = BASE.wheel_radius_m
        status_ns = now_ns - _int(given_step["status_age_ms"]) * MS
        status = WheelStatus(
            measured_ns=status_ns,
            left_rad_s=surfaces_m_s[0] / radius,
            right_rad_s=surfaces_m_s[1] / radius,
            drives_enabled=True,
            left_rad=0.0,
            right_rad=0.0,
        )
        inputs = given_step["inputs"]
        assert isinstance(inputs, tuple)
        decision = gate.step(
            now_ns,
            StampedCommand(command=command, run_id=_int(given_step["run_id"]), boot_id=BOOT),
            token,
            status,
            StopInputs(fresh=inputs[0], estop_clear=inputs[1], protective_clear=inputs[2]),
        )
        v, w = decision.v_m_s, decision.w_rad_s
        if v or w:
            assert all(inputs)
            assert token.armed
            assert 0 <= now_ns - token_ns <= 200 * MS
            assert 0 <= now_ns - status_ns <= 50 * MS
            assert -min(0.1, cap) - EPS <= v <= min(0.5, cap) + EPS
            assert abs(w) <= min(0.6, cap) + EPS
            allowed = min(max(after_ms, 0), 20) / 1000
            assert abs(v) <= abs(last_v) + 0.5 * allowed + EPS
            assert abs(w) <= abs(last_w) + 2.0 * allowed + EPS
        assert math.isfinite(v)
        assert math.isfinite(w)
        last_v, last_w = v, w


def _under_way() -> tuple[Gate, int, float, float]:
    """A gate that has driven for a tenth of a second, the time, and what it last let through."""
    gate, now_ns, last = Gate(LIMITS, BASE, BOOT), 10_000 * MS, (0.0, 0.0)
    first = seal_command(Command(0.3, 0.2, 1, 1, now_ns, now_ns + 1000 * MS, 1, now_ns))
    paths = [0.0, 0.0]
    for n in range(12):
        left, right = last[0] - last[1] / 4, last[0] + last[1] / 4
        paths = [path + speed * 0.01 for path, speed in zip(paths, (left, right), strict=True)]
        status = WheelStatus(
            measured_ns=now_ns,
            left_rad_s=left / BASE.wheel_radius_m,
            right_rad_s=right / BASE.wheel_radius_m,
            drives_enabled=True,
            left_rad=paths[0] / BASE.wheel_radius_m,
            right_rad=paths[1] / BASE.wheel_radius_m,
        )
        token = ArmToken(
            armed=True, stamp_ns=now_ns, boot_id=BOOT, epoch=1, phase="approach", v_max_m_s=0.5, w_max_rad_s=0.6
        )
        decision = gate.step(
            now_ns,
            StampedCommand(command=first, run_id=5, boot_id=BOOT),
            token,
            status,
            StopInputs(fresh=True, estop_clear=True, protective_clear=True),
        )
        last = (decision.v_m_s, decision.w_rad_s)
        now_ns += 10 * MS * (n < 11)
    assert decision.rule == ""
    return gate, now_ns, *last


def _int(value: object) -> int:
    assert isinstance(value, int)
    return value


def _float(value: object) -> float:
    assert isinstance(value, float)
    return value
