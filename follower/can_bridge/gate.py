"""The gate: the last function before the wheels. It trusts nothing above it and can only reduce motion.

docs/safety.md, layer 2. Pure: measurement and time are arguments of :meth:`Gate.step`, which is called before every
frame. Each rule has a name; the decision names the rule that stopped or changed the command. Configuration and
mission can only lower the ceilings (:mod:`common.ceilings`).
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Final

from common.ceilings import (
    HARD_ACCELERATION_M_S2,
    HARD_ANGULAR_ACCELERATION_RAD_S2,
    HARD_V_MAX_M_S,
    HARD_V_MIN_M_S,
    HARD_W_MAX_RAD_S,
    PHASE_CAPS,
    STILL,
)
from common.config import BaseConfig, LimitsConfig
from common.messages import Command, Phase, command_checksum
from common.timing import NS_PER_MS, NS_PER_S
from follower.can_bridge.angle_watch import AngleWatch
from follower.can_bridge.measurement import STATUS_MAX_AGE_MS
from follower.can_bridge.wheel_tracking import WheelTrackingMonitor

COMMAND_MAX_AGE_MS: Final = 120
TOKEN_MAX_AGE_MS: Final = 200
WINDOW_MS: Final = 250
WINDOW_ENTRIES: Final = 128
MAX_STEP_MS: Final = 20
MAX_TRACKING_GAP_M_S: Final = 0.15
MAX_TRACKING_GAP_SHARE: Final = 0.20
MAX_MEASURED_JUMP_M_S: Final = 0.30
MAX_MEASURED_STEP_M: Final = 0.05
"""Of a wheel's surface between two measurements at most 50 ms apart: at its cap it rolls 0.03 m meanwhile."""
ROUNDING: Final = 1e-9
"""Share of a command: a set-point at its cap may be above it by the last bits, and is no intervention."""
LATCHING: Final = frozenset({"second_writer"})
"""Reasons to drop a command that stop the wheels until the next epoch; so do the rules measured_*."""


@dataclass(frozen=True, kw_only=True)
class StampedCommand:
    """A command with what its envelope adds: the writer's run and the boot that its stamps count from."""

    command: Command
    run_id: int
    boot_id: str


@dataclass(frozen=True, kw_only=True)
class ArmToken:
    """The newest mission: armed or not, its stamp, its epoch, and the caps that it sets for {F}."""

    armed: bool
    stamp_ns: int
    boot_id: str
    epoch: int
    phase: Phase
    v_max_m_s: float
    w_max_rad_s: float


@dataclass(frozen=True, kw_only=True)
class WheelStatus:
    """Speeds and angles that the wheel drives measured at ``measured_ns``, −1 for never.

    ``drives_enabled``: all drives that the robot needs for moving are in operation; in the bridge, wheels and arms.
    """

    measured_ns: int
    left_rad_s: float
    right_rad_s: float
    left_rad: float
    right_rad: float
    drives_enabled: bool


@dataclass(frozen=True, kw_only=True)
class StopInputs:
    """Emergency and protective stop as the I/O module reports them; not ``fresh`` counts as stop."""

    fresh: bool
    estop_clear: bool
    protective_clear: bool


@dataclass(frozen=True, kw_only=True)
class Decision:
    """What goes to the wheels.

    ``rule`` names what made it zero, or is "" while a command is followed; ``clipped`` names what limited the
    command; ``dropped`` says why a newly arrived command was not accepted, or is "". ``sequence`` is that of the last
    accepted command.
    """

    v_m_s: float
    w_rad_s: float
    rule: str
    clipped: tuple[str, ...]
    dropped: str
    sequence: int


class Gate:
    """Keeps what the rules need from earlier frames: the accepted command, the last set-points, a latched rule."""

    _latched: str

    def __init__(self, limits: LimitsConfig, base: BaseConfig, boot_id: str) -> None:
        self._v_max = min(limits.v_max_m_s, HARD_V_MAX_M_S)
        self._v_min = max(limits.v_min_m_s, HARD_V_MIN_M_S)
        self._w_max = min(limits.w_max_rad_s, HARD_W_MAX_RAD_S)
        self._acceleration = min(limits.gate_acceleration_m_s2, HARD_ACCELERATION_M_S2)
        self._turn_acceleration = min(limits.gate_angular_acceleration_rad_s2, HARD_ANGULAR_ACCELERATION_RAD_S2)
        self._radius = base.wheel_radius_m
        self._half_track = base.track_m / 2.0
        self._boot_id = boot_id
        self._begin(None)
        self._last_ns: int | None = None
        self._v = 0.0
        self._w = 0.0
        self._window: deque[tuple[int, float, float]] = deque(maxlen=WINDOW_ENTRIES)
        self._status: WheelStatus | None = None
        self._tracking = (WheelTrackingMonitor(), WheelTrackingMonitor())
        self._angles = (AngleWatch(), AngleWatch())

    def step(
        self,
        now_ns: int,
        newest: StampedCommand | None,
        token: ArmToken | None,
        status: WheelStatus,
        inputs: StopInputs,
    ) -> Decision:
        """Decide the set-point for the frame that is about to be sent.

        Args:
            now_ns: CLOCK_MONOTONIC of this boot.
            newest: the newest command that arrived, new or already seen; None before the first.
            token: the newest mission; None before the first.
            status: newest measurement of the wheels.
            inputs: emergency and protective stop.

        Returns:
            Speed and turning rate of {F} to send, zero unless every rule is satisfied, with the rules that acted.
        """
        if token is not None and token.epoch != self._epoch:
            self._begin(token.epoch)
        dropped = self._accept(newest, token)
        wrong = self._jumped(status)
        if wrong:
            self._angles = (AngleWatch(), AngleWatch())
        else:
            wrong = self._contradicted(status)
        self._latched = self._latched or wrong or (dropped if dropped in LATCHING else "")
        rule = self._stop_rule(now_ns, token, status, inputs) or self._latched
        clipped: list[str] = []
        v, w = 0.0, 0.0
        if not rule and self._held is not None and token is not None:
            v, w = self._limit(now_ns, self._held, token, clipped)
        off = self._not_tracking(now_ns, v, w, status)
        if off:
            rule = self._latched = off
            v, w = 0.0, 0.0
        self._remember(now_ns, v, w)
        return Decision(
            v_m_s=v, w_rad_s=w, rule=rule, clipped=tuple(clipped), dropped=dropped, sequence=self._sequence
        )

    # -- accepting a command

    def _begin(self, epoch: int | None) -> None:
        """A new epoch forgets the old one's command, writer, sequence and latched rule."""
        self._epoch = epoch
        self._held: Command | None = None
        self._writer: int | None = None
        self._sequence = -1
        self._latched = ""

    def _accept(self, newest: StampedCommand | None, token: ArmToken | None) -> str:
        """Hold a new command if it is genuine; the reason if it is not. Age is checked on every frame, not here."""
        if newest is None or newest.command == self._held:
            return ""
        reason = self._refusal(newest, token)
        if not reason:
            self._held = newest.command
            self._writer = newest.run_id
            self._sequence = newest.command.sequence
        return reason

    def _refusal(self, newest: StampedCommand, token: ArmToken | None) -> str:
        command = newest.command
        if not (math.isfinite(command.v_m_s) and math.isfinite(command.w_rad_s)):
            return "not_finite"
        if command.checksum != command_checksum(command):
            return "checksum"
        if newest.boot_id != self._boot_id:
            return "boot"
        if token is None or not token.armed:
            return "not_armed"
        if command.epoch != token.epoch:
            return "epoch"
        if self._writer is not None and newest.run_id != self._writer:
            return "second_writer"
        if command.sequence <= self._sequence:
            return "sequence"
        return ""

    # -- rules that make it zero

    def _stop_rule(self, now_ns: int, token: ArmToken | None, status: WheelStatus, inputs: StopInputs) -> str:
        if not (inputs.fresh and inputs.estop_clear and inputs.protective_clear):
            return "stop_input"
        if status.measured_ns < 0 or not _young(now_ns, status.measured_ns, STATUS_MAX_AGE_MS):
            return "status_age"
        if token is None or not token.armed or token.boot_id != self._boot_id:
            return "not_armed"
        if not _young(now_ns, token.stamp_ns, TOKEN_MAX_AGE_MS):
            return "token_age"
        if not (token.v_max_m_s >= 0.0 and token.w_max_rad_s >= 0.0):  # also false for NaN
            return "token_caps"
        if not status.drives_enabled:
            return "not_enabled"
        held = self._held
        if held is None:
            return "no_command"
        if not _young(now_ns, held.stamp_ns, COMMAND_MAX_AGE_MS):
            return "command_age"
        if now_ns > held.valid_until_ns:
            return "valid_until"
        return ""

    def _jumped(self, status: WheelStatus) -> str:
        """Neither speed nor angle of an encoder can change like that between two frames."""
        before, self._status = self._status, status
        if not all(map(math.isfinite, (status.left_rad_s, status.right_rad_s, status.left_rad, status.right_rad))):
            return "measured_jump"
        if before is None or before.measured_ns < 0 or status.measured_ns < 0:
            return ""
        if not _young(status.measured_ns, before.measured_ns, STATUS_MAX_AGE_MS):
            return ""
        faster = max(abs(status.left_rad_s - before.left_rad_s), abs(status.right_rad_s - before.right_rad_s))
        farther = max(abs(status.left_rad - before.left_rad), abs(status.right_rad - before.right_rad))
        jumped = faster * self._radius > MAX_MEASURED_JUMP_M_S or farther * self._radius > MAX_MEASURED_STEP_M
        return "measured_jump" if jumped else ""

    def _contradicted(self, status: WheelStatus) -> str:
        """An angle that does not follow its speed: an encoder that stands, runs backwards or has another scale."""
        wheels = ((status.left_rad, status.left_rad_s), (status.right_rad, status.right_rad_s))
        wrong = [
            watch.step(status.measured_ns, angle * self._radius, speed * self._radius)
            for watch, (angle, speed) in zip(self._angles, wheels, strict=True)
        ]
        return "measured_angle" if any(wrong) else ""

    def _not_tracking(self, now_ns: int, v: float, w: float, status: WheelStatus) -> str:
        """A wheel does not follow its set-point: blocked, stuck encoder, wrong sign. Checked on every frame."""
        turn = w * self._half_track
        surfaces = (
            (v - turn, status.left_rad_s * self._radius, self._tracking[0]),
            (v + turn, status.right_rad_s * self._radius, self._tracking[1]),
        )
        stuck = [monitor.step(now_ns, commanded, measured) for commanded, measured, monitor in surfaces]
        if any(_beyond(commanded, measured) for commanded, measured, _ in surfaces):
            return "measured_gap"
        return "measured_stuck" if any(stuck) else ""

    # -- rules that limit it

    def _limit(self, now_ns: int, command: Command, token: ArmToken, clipped: list[str]) -> tuple[float, float]:
        """Caps, rate, window; each scales v and ω together.

        A lowered cap and a command to stand apply at once: the drive ramps.
        """
        if command.v_m_s == 0.0 and command.w_rad_s == 0.0:
            return 0.0, 0.0
        scale = self._cap_scale(command.v_m_s, command.w_rad_s, token)
        dv, dw = command.v_m_s * scale - self._v, command.w_rad_s * scale - self._w
        dt_s = self._step_s(now_ns)
        rate = min(_share(dv, self._acceleration * dt_s), _share(dw, self._turn_acceleration * dt_s))
        window = self._window_share(now_ns, dv, dw)
        share = min(rate, window)
        v, w = self._v + share * dv, self._w + share * dw
        lowered = self._cap_scale(v, w, token)
        if min(scale, lowered) < 1.0 - ROUNDING:
            clipped.append("cap")
        if rate < 1.0:
            clipped.append("rate")
        if window < rate:
            clipped.append("window")
        return v * lowered, w * lowered

    def _cap_scale(self, v: float, w: float, token: ArmToken) -> float:
        """The factor ≤ 1 that brings v, ω and both wheels within the caps of configuration, phase and mission."""
        cap = PHASE_CAPS.get(token.phase, STILL)
        return min(
            _share(max(v, 0.0), min(self._v_max, cap.v_m_s, token.v_max_m_s)),
            _share(min(v, 0.0), min(-self._v_min, cap.v_m_s, token.v_max_m_s)),
            _share(w, min(self._w_max, cap.w_rad_s, token.w_max_rad_s)),
            _share(abs(v) + abs(w) * self._half_track, cap.wheel_m_s),
        )

    def _step_s(self, now_ns: int) -> float:
        """Time since the last frame; a stall allows no larger step."""
        if self._last_ns is None:
            return 0.0
        return min(max(now_ns - self._last_ns, 0), MAX_STEP_MS * NS_PER_MS) / NS_PER_S

    def _window_share(self, now_ns: int, dv: float, dw: float) -> float:
        """The share of the change that keeps the real change over the last 250 ms within what the rates allow.

        An independent check of the rate rule: it does not use the step's duration. Slowing down to zero is free.
        """
        while self._window and now_ns - self._window[0][0] > WINDOW_MS * NS_PER_MS:
            self._window.popleft()
        reach_v = self._acceleration * WINDOW_MS / 1000.0
        reach_w = self._turn_acceleration * WINDOW_MS / 1000.0
        return min(
            _reach_share(self._v, dv, [entry[1] for entry in self._window], reach_v),
            _reach_share(self._w, dw, [entry[2] for entry in self._window], reach_w),
        )

    def _remember(self, now_ns: int, v: float, w: float) -> None:
        self._last_ns, self._v, self._w = now_ns, v, w
        self._window.append((now_ns, v, w))


def _young(now_ns: int, stamp_ns: int, max_age_ms: int) -> bool:
    """Neither too old nor stamped in the future."""
    return 0 <= now_ns - stamp_ns <= max_age_ms * NS_PER_MS


def _share(wanted: float, allowed: float) -> float:
    """The share, at most 1, of ``wanted`` whose magnitude is within ``allowed``."""
    magnitude = abs(wanted)
    return allowed / magnitude if magnitude > allowed else 1.0


def _beyond(setpoint: float, measured: float) -> bool:
    """Whether a wheel's set-point exceeds the measured surface speed by more than lag and load explain.

    A set-point that slows down is accepted however far it is from the measurement.
    """
    gap = math.copysign(1.0, setpoint) * (setpoint - measured)
    return setpoint != 0.0 and gap > MAX_TRACKING_GAP_M_S + MAX_TRACKING_GAP_SHARE * abs(setpoint)


def _reach_share(now: float, change: float, window: list[float], reach: float) -> float:
    """The share of ``change`` after which the set-point is within ``reach`` of every one in the window.

    Changes towards zero are free: a set-point that was forced to zero is not held back by the window.
    """
    sign = math.copysign(1.0, change)
    slowest = min((sign * value for value in window), default=sign * now)
    return _share(change, max(0.0, max(0.0, slowest + reach) - sign * now))
