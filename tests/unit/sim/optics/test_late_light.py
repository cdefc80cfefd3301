"""Light older than its stamp."""

from __future__ import annotations

import math

import pytest

from common.timing import NS_PER_MS
from sim.optics.late_light import LateLight
from sim.world_message import WorldState

PERIOD_NS = 16 * NS_PER_MS


def state(number: int, theta_rad: float = 0.0) -> WorldState:
    """Driving 1 m a period, its number in x."""
    return WorldState(
        sequence=number,
        time_ns=number * PERIOD_NS,
        x_m=float(number),
        y_m=0.0,
        theta_rad=theta_rad,
        v_m_s=0.0,
        w_rad_s=0.0,
        pitch_rad=0.0,
        roll_rad=0.0,
        led_current_a=(1.0,),
        beam_x_m=0.0,
        handle_force_n=0.0,
        gripped=True,
        seated=False,
        locked=False,
    )


def test_prompt_light_shows_the_newest_state_itself() -> None:
    newest = state(1)
    assert LateLight(0).seen_in(newest) is newest


@pytest.mark.parametrize("late_periods", [0.25, 1.0, 1.5, 2.4])
def test_late_light_shows_where_the_robot_was(late_periods: float) -> None:
    late = LateLight(round(late_periods * PERIOD_NS))
    shown = [late.seen_in(state(number)).x_m for number in range(1, 9)]
    assert shown[0] == 1.0  # nothing before the first
    assert shown[4:] == pytest.approx([number - late_periods for number in range(5, 9)])


def test_headings_mix_across_the_half_turn() -> None:
    late = LateLight(PERIOD_NS // 2)
    late.seen_in(state(1, math.pi - 0.02))
    shown = late.seen_in(state(2, -math.pi + 0.01))
    assert shown.theta_rad == pytest.approx(math.pi - 0.005)
