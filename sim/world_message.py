"""What the simulated world tells the simulated light and the observer of an experiment: true, not measured."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field
from pydantic.dataclasses import dataclass

from common.channels import Channel
from common.messages import STRICT, Angle, Metres, Ns, Speed


@dataclass(frozen=True, config=STRICT)
class WorldState:
    """The world at ``time_ns``: Follower pose and twist in {L}, camera tilt, light, trolleys and lock.

    ``sequence`` numbers the exposures; the camera renders one frame for each. ``trolley`` is the handle's pose
    (x [m], y [m], θ [rad]) in {L} of the trolley in hand or last held, ``queue`` those of the trolleys nested before,
    the first of them first. ``lock_travel``: 0 open, 1 locked. ``occluders`` hide light: x, y, radius [m].
    """

    SCHEMA: ClassVar[str] = "world_state/2"
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
    lifted: bool = False
    lock_travel: Annotated[float, Field(ge=0, le=1)] = 0.0
    trolley: tuple[Metres, Metres, Angle] = (0.0, 0.0, 0.0)
    queue: Annotated[tuple[tuple[Metres, Metres, Angle], ...], Field(max_length=99)] = ()
    occluders: Annotated[tuple[tuple[Metres, Metres, Metres], ...], Field(max_length=16)] = ()


WORLD = Channel("world/state", WorldState, "world", 60, 100)
