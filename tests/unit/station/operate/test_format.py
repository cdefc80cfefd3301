"""Lines for people about running robots."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from common.geometry import Pose2
from common.messages import FollowerSummary
from station.operate.format import follower_line, leader_line, place

GOAL = Pose2(1.4, 0.0, 0.0)


def test_where_the_follower_stands_is_its_error_against_the_goal() -> None:
    state: Any = SimpleNamespace(valid=True, x_m=2.0, y_m=-0.1, theta_rad=0.0)
    assert place(state, GOAL) == "to goal 0.60 m  lateral +10.0 cm  heading -0.00°"
    assert place(None, GOAL) == "LEDs not seen"


def test_a_line_of_the_follower_names_what_it_waits_for() -> None:
    state = FollowerSummary(
        phase="push",
        cause="",
        waiting="drives",
        trolley=2,
        armed=True,
        moving=False,
        in_contact=True,
        gripped=True,
        needs_reset=False,
    )
    assert follower_line(state) == "push, trolley 2, armed, in contact, gripped, waiting for: drives"


def test_silence_is_named() -> None:
    assert leader_line(None) == follower_line(None) == "no state received"
