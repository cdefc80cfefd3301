"""Keys and fingers at the station."""

from __future__ import annotations

from dataclasses import replace

from common.timing import NS_PER_MS, NS_PER_S
from station.operate.manual import Fingers, Keys, ManualFeedback
from tests.rigs.supervisor_rig import ARMS
from tests.rigs.supervisor_rig import DRIVES as DISARMED


def test_held_arrow_keys_move_and_let_go_they_stop() -> None:
    keys = Keys(0.05, 0.2)
    assert keys.step(0, "") == (0.0, 0.0)
    assert keys.step(0, "\x1b[A") == (0.05, 0.0)
    assert keys.step(500 * NS_PER_MS, "\x1b[A\x1b[A") == (0.05, 0.0)
    assert keys.step(640 * NS_PER_MS, "") == (0.05, 0.0)
    assert keys.step(650 * NS_PER_MS, "") == (0.0, 0.0)
    assert keys.step(700 * NS_PER_MS, "\x1b[D") == (0.0, 0.2)
    assert keys.step(710 * NS_PER_MS, " ") == (0.0, 0.0)
    assert keys.step(720 * NS_PER_MS, "\x1b[B") == (-0.05, 0.0)
    assert keys.step(1270 * NS_PER_MS, "") == (0.0, 0.0)


def test_fingers_are_done_when_open_or_when_they_stand() -> None:
    def felt(now_s: float, angle: float, gripped: bool = False, released: bool = False) -> ManualFeedback:
        state = replace(ARMS, gripped=gripped, released=released)
        return ManualFeedback(round(now_s * NS_PER_S), None, replace(DISARMED, grip_angle_rad=(angle, angle)), state)

    opening = Fingers("open")
    assert opening.step(felt(0.0, 0.2)) == (0.0, 0.0)
    assert opening.step(felt(0.5, 1.1, released=True)) is None
    closing = Fingers("closed")
    assert closing.step(felt(0.0, 1.0)) == (0.0, 0.0)
    assert closing.step(felt(0.9, 0.15, gripped=True)) == (0.0, 0.0)
    assert closing.step(felt(1.8, 0.15, gripped=True)) == (0.0, 0.0)
    assert closing.step(felt(1.9, 0.15, gripped=True)) is None
