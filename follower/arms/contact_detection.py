"""What joint torques and grippers tell of the trolley: contact and connection, slip, collision."""

from __future__ import annotations

from collections import deque

from common.config import ArmsConfig
from common.messages import ArmCause

_RELEASE_SHARE = 0.5
_CONTACT_HOLD_S = 0.15
_CONNECTED_HOLD_S = 0.05
_FORCE_FILTER_S = 0.04
_RESISTANCE_FILTER_S = 1.0
_SPIKE_S = 0.009
_RATE_WINDOW_S = 0.029
_WEAK_S = 0.03
_GRIP_TORQUE_SHARE = 0.5
_GRIP_SETTLE_S = 0.3
_SUSPECT_SHARE = 0.25


class Threshold:
    """On when a force stays above for ``hold_s``, off when it falls below half."""

    def __init__(self, hold_s: float) -> None:
        self._hold_s = hold_s
        self._above_s = 0.0
        self.on = False

    def step(self, force_n: float, threshold_n: float, dt_s: float) -> bool:
        """Take one sample."""
        self._above_s = self._above_s + dt_s if force_n > threshold_n else 0.0
        if self._above_s >= self._hold_s:
            self.on = True
        elif force_n < _RELEASE_SHARE * threshold_n:
            self.on = False
        return self.on


class ContactSense:
    """Contact is a lasting change of the handle's force, connection a greater force: the paper's torque variation.

    The change counts from the resistance that was learned while the trolley rolled; speeding up a trolley of
    ``inertia_allowance_kg`` is none. By torque alone the edge of a pad, climbed slowly, feels like the guide: the
    paper adds the visual error, so contact is told only where it is expected. ``force_n``, ``resistance_n`` are
    along the chassis.
    """

    def __init__(self, config: ArmsConfig) -> None:
        self._config = config
        self._contact = Threshold(_CONTACT_HOLD_S)
        self._connected = Threshold(_CONNECTED_HOLD_S)
        self.force_n = 0.0
        self.resistance_n = 0.0

    @property
    def contact(self) -> bool:
        """Whether something ahead resists."""
        return self._contact.on

    @property
    def connected(self) -> bool:
        """Whether it resists rigidly."""
        return self._connected.on

    def step(
        self, force_n: float, acceleration_m_s2: float, dt_s: float, *, rolling: bool = False, expected: bool = False
    ) -> None:
        """Take one sample.

        Args:
            force_n: along the chassis, unfiltered.
            acceleration_m_s2: of the base.
            dt_s: since the last sample.
            rolling: driving ahead with nothing to be met, so that resistance may be learned.
            expected: the visual error has settled at the goal, and the trolley is pushed on.
        """
        config = self._config
        self.force_n += min(1.0, dt_s / _FORCE_FILTER_S) * (force_n - self.force_n)
        allowed_n = config.contact_force_n + config.inertia_allowance_kg * abs(acceleration_m_s2)
        self._contact.step(self.force_n - self.resistance_n if expected else 0.0, allowed_n, dt_s)
        self._connected.step(self.force_n, config.connected_force_n, dt_s)
        if rolling and not expected:
            learned = self.resistance_n + min(1.0, dt_s / _RESISTANCE_FILTER_S) * (self.force_n - self.resistance_n)
            self.resistance_n = min(config.pushing_force_n, max(0.0, learned))


class CollisionSense:
    """A joint torque over its limit, or one that grows too fast, for 2 samples 10 ms apart: SAFETY.md, row 39.

    For one sample it also grows too fast where a command of the base turns casters that swing round under a load.
    """

    def __init__(self, config: ArmsConfig) -> None:
        self._config = config
        self._over_s: float | None = None
        self._fast_s: float | None = None
        self._recent: deque[tuple[float, tuple[float, ...]]] = deque()

    def step(self, torques_n_m: tuple[float, ...], dt_s: float) -> bool:
        """Take one sample of the six joint torques, ``dt_s`` after the one before."""
        config = self._config
        over = max(map(abs, torques_n_m)) > config.collision_torque_n_m
        fast = self._rate(torques_n_m, dt_s) > config.collision_rate_n_m_s
        self._over_s, self._fast_s = _lasting(self._over_s, over, dt_s), _lasting(self._fast_s, fast, dt_s)
        return any(lasted_s is not None and lasted_s >= _SPIKE_S for lasted_s in (self._over_s, self._fast_s))

    def forget(self) -> None:
        """What was sampled before does not count."""
        self._over_s = self._fast_s = None
        self._recent.clear()

    def _rate(self, torques_n_m: tuple[float, ...], dt_s: float) -> float:
        """Fastest growth [N·m/s] of a joint's torque over the last 30 ms; samples need not come evenly."""
        recent = self._recent
        for _ in range(len(recent)):
            age_s, torques = recent.popleft()
            recent.append((age_s + dt_s, torques))
        recent.append((0.0, torques_n_m))
        while len(recent) > 1 and recent[1][0] >= _RATE_WINDOW_S:
            recent.popleft()
        age_s, oldest = recent[0]
        if age_s < _RATE_WINDOW_S:
            return 0.0
        return max(abs(b) - abs(a) for a, b in zip(oldest, torques_n_m, strict=True)) / age_s


class SlipSense:
    """The handle leaves a gripper: its finger jumps, or its torque drops once it had settled: row 38.

    ``suspected``: the newest sample looks like the beginning of it.
    """

    def __init__(self, config: ArmsConfig) -> None:
        self._config = config
        self._held_s = 0.0
        self._angles: tuple[float, float] | None = None
        self._weak_s = 0.0
        self.suspected = False

    def step(self, angles_rad: tuple[float, float], torques_n_m: tuple[float, float], dt_s: float) -> bool:
        """Take one sample while the grippers hold with full torque."""
        self._held_s += dt_s
        if self._angles is None:
            self._angles = angles_rad
        jump = max(abs(now - then) for now, then in zip(angles_rad, self._angles, strict=True))
        settled = self._held_s >= _GRIP_SETTLE_S
        weak = settled and min(torques_n_m) < _GRIP_TORQUE_SHARE * self._config.grip_torque_n_m
        self._weak_s = self._weak_s + dt_s if weak else 0.0
        self.suspected = weak or jump > _SUSPECT_SHARE * self._config.slip_jump_rad
        return jump > self._config.slip_jump_rad or self._weak_s >= _WEAK_S

    def forget(self) -> None:
        """The grippers hold anew, or no longer."""
        self._held_s, self._angles, self._weak_s = 0.0, None, 0.0
        self.suspected = False


def _lasting(lasted_s: float | None, holds: bool, dt_s: float) -> float | None:
    """For how long it has held since the first sample at which it did; None if it does not."""
    if not holds:
        return None
    return 0.0 if lasted_s is None else lasted_s + dt_s


def first_cause(slipped: bool, collided: bool) -> ArmCause:
    """The worse of what happened."""
    return "collision" if collided else "slip" if slipped else "ok"
