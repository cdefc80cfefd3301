"""The true state of the simulated world, for the simulated optics and for experiments."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field
from pydantic.dataclasses import dataclass

from common.channels import Channel
from common.messages import STRICT, Angle, Metres, Ns, Speed


@dataclass(frozen=True, config=STRICT)
class WorldState:
    """The world at ``time_ns``: Follower pose and twist in {L}, camera tilt, light, trolleys and lock."""

    SCHEMA: ClassVar[str] = "world_state/2"
    # number of the exposure; the camera renders one frame for each
    sequence: Annotated[int, Field(ge=1, lt=2**63)]
    time_ns: Ns
    # pose of {F} in {L}
    x_m: Metres
    y_m: Metres
    theta_rad: Angle
    v_m_s: Speed
    w_rad_s: Speed
    # tilt of the camera: up, and right side down
    pitch_rad: Angle
    roll_rad: Angle
    led_current_a: Annotated[tuple[float, ...], Field(max_length=12)]
    # front beam of the trolley in hand or last held, along x of {L}
    beam_x_m: Metres
    # push of the arms on the handle
    handle_force_n: float
    gripped: bool
    # first beam in the guide; bolt behind it; guide lifted by a beam below
    seated: bool
    locked: bool
    lifted: bool = False
    # of the bolt: 0 open, 1 locked
    lock_travel: Annotated[float, Field(ge=0, le=1)] = 0.0
    # handle of the trolley in hand or last held: x [m], y [m], θ [rad] in {L}
    trolley: tuple[Metres, Metres, Angle] = (0.0, 0.0, 0.0)
    # handles of the nested trolleys, in the order of docking
    queue: Annotated[tuple[tuple[Metres, Metres, Angle], ...], Field(max_length=99)] = ()
    # obstacles that block light: x, y in {L}, radius [m]
    occluders: Annotated[tuple[tuple[Metres, Metres, Metres], ...], Field(max_length=16)] = ()


WORLD = Channel("world/state", WorldState, "world", 60, 100)
