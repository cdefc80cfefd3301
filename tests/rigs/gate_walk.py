"""A random walk through the gate's inputs, and what must hold at every step whatever they were.

The checks are written independently from docs/safety.md, layer 2; they do not look at the gate's state.
"""

from __future__ import annotations

import math
from collections import deque
from random import Random

from common.messages import PHASES, Command, Phase, command_checksum, seal_command
from follower.can_bridge.gate import ArmToken, Decision, Gate, StampedCommand, StopInputs, WheelStatus
from tests.rigs.gate_rig import BASE, BOOT, LIMITS, MS

EPS = 1e-9
STILL_PHASES = ("idle", "release", "done", "aborted")
SLOW_PHASES = {
    "staging": 0.10,
    "search": 0.0,
    "acquire": 0.10,
    "insert": 0.05,
    "push": 0.05,
    "lock": 0.05,
    "retract": 0.10,
}


class Walk:
    """One seeded walk; :meth:`step` draws inputs, steps the gate and checks the decision."""

    def __init__(self, seed: int) -> None:
        self.random = Random(seed)
        self.gate = Gate(LIMITS, BASE, BOOT)
        self.now_ns = 10_000 * MS
        self.epoch = 1
        self.sequence = 0
        self.phase: Phase = "approach"
        self.target = (0.3, 0.1)
        self.measured = [0.0, 0.0]
        self.paths_m = [0.0, 0.0]
        self.jumped_epoch = 0
        self.newest: StampedCommand | None = None
        self.offered: deque[StampedCommand] = deque(maxlen=64)
        self.last = (0.0, 0.0)
        self.last_ns = self.now_ns
        self.window: deque[tuple[int, float, float]] = deque()
        self.status = WheelStatus(
            measured_ns=-1, left_rad_s=0.0, right_rad_s=0.0, drives_enabled=True, left_rad=0.0, right_rad=0.0
        )
        self.moved = 0

    def step(self) -> Decision:
        """One frame."""
        self._pass_time()
        self._maybe_command()
        token = self._token()
        self._measure()
        chance = self.random.random()
        inputs = StopInputs(fresh=chance > 0.003, estop_clear=chance > 0.006, protective_clear=chance > 0.009)
        decision = self.gate.step(self.now_ns, self.newest, token, self.status, inputs)
        self._judge(decision, token, inputs)
        self.last, self.last_ns = (decision.v_m_s, decision.w_rad_s), self.now_ns
        self.window.append((self.now_ns, *self.last))
        return decision

    # -- drawing

    def _pass_time(self) -> None:
        draw = self.random.random()
        if draw < 0.9:
            self.now_ns += 10 * MS
        elif draw < 0.995:
            self.now_ns += self.random.randrange(0, 40 * MS)
        else:
            self.now_ns += self.random.randrange(0, 3000 * MS)

    def _maybe_command(self) -> None:
        draw = self.random.random()
        if draw > 0.3:
            return
        if draw < 0.02:
            self.target = (self.random.uniform(-0.3, 0.8), self.random.uniform(-1.0, 1.0))
        self.sequence += 1
        fields = [*self.target, self.epoch, self.sequence, self.now_ns]
        stamp = self.now_ns - self.random.randrange(0, 30 * MS)
        run_id, boot_id = 5, BOOT
        if draw < 0.03:
            match self.random.randrange(8):
                case 0:
                    fields[3] = max(0, self.sequence - self.random.randrange(1, 9))
                case 1:
                    fields[2] = self.epoch + self.random.choice((-1, 1))
                case 2:
                    stamp = self.now_ns - self.random.randrange(0, 400 * MS)
                case 3:
                    stamp = self.now_ns + self.random.randrange(1, 400 * MS)
                case 4:
                    boot_id = "other"
                case 5:
                    run_id = 6
                case 6 if self.offered:
                    self.newest = self.random.choice(self.offered)
                    return
        v, w, epoch, sequence, _ = fields
        lifetime = self.random.choice((60, 120, 500)) * MS
        command = seal_command(
            Command(v, w, int(epoch), int(sequence), stamp, stamp + lifetime, int(sequence), stamp)
        )
        if draw < 0.0015:
            object.__setattr__(command, "v_m_s", self.random.choice((math.nan, math.inf, 0.4)))
        self.newest = StampedCommand(command=command, run_id=run_id, boot_id=boot_id)
        self.offered.append(self.newest)

    def _token(self) -> ArmToken | None:
        draw = self.random.random()
        if draw < 0.004:
            self.epoch += 1
            self.sequence = 0
        if draw > 0.997:
            self.phase = self.random.choice((*PHASES, *("approach",) * 12))
        if 0.01 < draw < 0.012:
            return None
        stamp = self.now_ns - (
            self.random.randrange(0, 500 * MS) if draw < 0.02 else self.random.randrange(0, 60 * MS)
        )
        cap = 0.5 if draw < 0.95 else self.random.choice((0.0, 0.05, 0.1, math.nan, -1.0, 9.0))
        return ArmToken(
            armed=draw > 0.002,
            stamp_ns=stamp,
            boot_id=BOOT,
            epoch=self.epoch,
            phase=self.phase,
            v_max_m_s=cap,
            w_max_rad_s=0.6,
        )

    def _measure(self) -> None:
        turn = self.last[1] * BASE.track_m / 2
        for side, surface in enumerate((self.last[0] - turn, self.last[0] + turn)):
            step = max(-0.01, min(0.01, surface - self.measured[side]))
            self.measured[side] += step
        left, right = self.measured
        draw = self.random.random()
        if draw < 0.0005:
            left = self.random.choice((math.nan, math.inf, -left, left + 0.5))
        measured_ns = self.now_ns - (self.random.randrange(0, 80 * MS) if draw > 0.99 else 10 * MS)
        radius, before = BASE.wheel_radius_m, self.status
        elapsed_ns = max(0, measured_ns - before.measured_ns) if before.measured_ns >= 0 else 0
        paths = [path + speed * elapsed_ns * 1e-9 for path, speed in zip(self.paths_m, self.measured, strict=True)]
        if 0.0005 < draw < 0.001:
            paths[self.random.randrange(2)] += self.random.uniform(-0.2, 0.2)
        farthest = max(abs(now - then) for now, then in zip(paths, self.paths_m, strict=True))
        if farthest > 0.05 + EPS and 0 <= measured_ns - before.measured_ns <= 50 * MS:
            self.jumped_epoch = self.epoch
        self.paths_m = paths
        angles = paths[0] / radius, paths[1] / radius
        self.status = WheelStatus(
            measured_ns=measured_ns,
            left_rad_s=left / radius,
            right_rad_s=right / radius,
            drives_enabled=draw < 0.998,
            left_rad=angles[0],
            right_rad=angles[1],
        )

    # -- judging

    def _judge(self, decision: Decision, token: ArmToken | None, inputs: StopInputs) -> None:
        v, w = decision.v_m_s, decision.w_rad_s
        assert math.isfinite(v)
        assert math.isfinite(w)
        if v == 0.0 and w == 0.0:
            return
        self.moved += 1
        assert decision.rule == ""
        assert self.epoch != self.jumped_epoch
        assert inputs == StopInputs(fresh=True, estop_clear=True, protective_clear=True)
        self._judge_token(token, v, w)
        self._judge_command(decision)
        assert 0 <= self.now_ns - self.status.measured_ns <= 50 * MS
        assert self.status.drives_enabled
        self._judge_growth(v, LIMITS.gate_acceleration_m_s2, 0)
        self._judge_growth(w, LIMITS.gate_angular_acceleration_rad_s2, 1)

    def _judge_token(self, token: ArmToken | None, v: float, w: float) -> None:
        assert token is not None
        assert token.armed
        assert 0 <= self.now_ns - token.stamp_ns <= 200 * MS
        assert token.phase not in STILL_PHASES
        cap = min(SLOW_PHASES.get(token.phase, 0.5), token.v_max_m_s)
        assert -min(0.1, cap) - EPS <= v <= cap + EPS
        assert abs(w) <= min(0.6, token.w_max_rad_s) + EPS
        assert abs(v) + abs(w) * BASE.track_m / 2 <= 0.6 + EPS

    def _judge_command(self, decision: Decision) -> None:
        """It follows a genuine command that was offered and is young; from standstill with that one's curvature."""
        genuine = [
            offer.command
            for offer in self.offered
            if offer.command.sequence == decision.sequence
            and offer.command.epoch == self.epoch
            and offer.command.checksum == command_checksum(offer.command)
            and offer.boot_id == BOOT
            and 0 <= self.now_ns - offer.command.stamp_ns <= 120 * MS
            and self.now_ns <= offer.command.valid_until_ns
        ]
        assert genuine
        if self.last == (0.0, 0.0):
            v, w = decision.v_m_s, decision.w_rad_s
            assert any(abs(v * command.w_rad_s - w * command.v_m_s) < EPS for command in genuine)

    def _judge_growth(self, value: float, rate: float, axis: int) -> None:
        """Away from zero: at most the rate since the last frame, and over 250 ms at most what the rate allows."""
        before = self.last[axis]
        step = rate * min(self.now_ns - self.last_ns, 20 * MS) * 1e-9
        sign = math.copysign(1.0, value)
        assert sign * value <= max(0.0, sign * before) + step + EPS
        while self.window and self.now_ns - self.window[0][0] > 250 * MS:
            self.window.popleft()
        if self.window:
            lowest = min(sign * entry[axis + 1] for entry in self.window)
            assert sign * value <= max(0.0, lowest + rate * 0.25) + EPS
