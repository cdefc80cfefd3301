"""Slip of the handle out of a gripper, by finger angle and grip torque."""

from __future__ import annotations

from common.config import ArmsConfig
from common.timing import NS_PER_MS, HeldFor
from follower.arms.sampling import SampleInterval, step_held

_WEAK_NS = 30 * NS_PER_MS
_GRIP_SETTLE_NS = 300 * NS_PER_MS
_GRIP_TORQUE_SHARE = 0.5
_SUSPECT_SHARE = 0.25


class SlipDetector:
    """A finger jumps, or its torque drops after it had settled: ``docs/safety.md`` S38.

    ``suspected``: the newest sample looks like the beginning of a slip.
    """

    def __init__(self, config: ArmsConfig) -> None:
        self._config = config
        self._settled = HeldFor(_GRIP_SETTLE_NS)
        self._weak = HeldFor(_WEAK_NS)
        self._angles_rad: tuple[float, float] | None = None
        self.suspected = False

    def step(
        self, angles_rad: tuple[float, float], torques_n_m: tuple[float, float], interval: SampleInterval
    ) -> bool:
        """Take one sample of the (left, right) finger while the grippers hold with full torque; whether one slips."""
        if self._angles_rad is None:
            self._angles_rad = angles_rad
        jump_rad = max(abs(now - then) for now, then in zip(angles_rad, self._angles_rad, strict=True))
        settled = step_held(self._settled, interval, True)
        weak = settled and min(torques_n_m) < _GRIP_TORQUE_SHARE * self._config.grip_torque_n_m
        lasts = step_held(self._weak, interval, weak)
        self.suspected = weak or jump_rad > _SUSPECT_SHARE * self._config.slip_jump_rad
        return jump_rad > self._config.slip_jump_rad or lasts

    def forget(self) -> None:
        """The grippers close again, or no longer hold."""
        self._settled.reset()
        self._weak.reset()
        self._angles_rad = None
        self.suspected = False
