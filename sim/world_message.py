"""What the simulated world tells the simulated light and the observer of an experiment: true, not measured."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field
from pydantic.dataclasses import dataclass

from common.channels import Channel
from common.messages import STRICT, Angle, Metres, Ns, Speed


@dataclass(frozen=True, config=STRICT)
class WorldState:
    """The world at ``time_ns``: Follower pose and twist in {L}, camera tilt, light, trolley and lock.

    ``sequence`` numbers the exposures; the camera renders one frame for each.
    """

    SCHEMA: ClassVar[str] = "world_state/1"
    sequence: Annotated[int, Field(ge=1, lt=2**63)]
    time_ns: Ns
    x_m: Metres
    y_m: Metres
    theta_rad: Angle
    v_m_s: Speed
    w_rad_s: Speed
    pitch_rad: Angle
    roll_rad: Angle
    led_current_a: Annotated[tuple[float, ...], Field(max_length=12)]
    beam_x_m: Metres
    handle_force_n: float
    gripped: bool
    seated: bool
    locked: bool


WORLD = Channel("world/state", WorldState, "world", 60, 100)
