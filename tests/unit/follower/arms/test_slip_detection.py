"""Slip: what it is, and what it is not."""

from __future__ import annotations

from common.config import Config
from follower.arms.slip_detection import SlipDetector
from tests.rigs.arms_rig import GRIPPED, tick


def test_a_slip_is_a_jump_of_a_finger_or_a_lost_grip_torque(config: Config) -> None:
    full = (config.arms.grip_torque_n_m,) * 2
    sense = SlipDetector(config.arms)
    assert not any(sense.step(GRIPPED, (0.0, 0.0), tick()) for _ in range(20))
    assert not sense.suspected
    assert not any(sense.step(GRIPPED, full, tick()) for _ in range(100))
    assert sense.step((0.15, 0.15 - 1.2 * config.arms.slip_jump_rad), full, tick())
    sense.forget()
    assert not any(sense.step(GRIPPED, full, tick()) for _ in range(100))
    weak = [sense.step(GRIPPED, (full[0], 0.4 * full[1]), tick()) for _ in range(5)]
    assert (weak[0], weak[-1]) == (False, True)
