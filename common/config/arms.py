"""Both arms: geometry, gains, and thresholds of contact, slip and collision."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from common.config.section import Coordinate, NonNegative, Positive, Section

_Degree = Annotated[float, Field(ge=-360.0, le=360.0)]
Degrees = tuple[_Degree, _Degree]


class ArmsConfig(Section):
    """Both SCARA arms: geometry, gains, and thresholds of contact, slip and collision.

    The geometry is that of the left arm; the right arm is its mirror image. A triple of gains is one arm's: along x
    and y of the handle [N/m, N·s/m], and about its vertical axis [N·m/rad, N·m·s/rad].
    """

    base_xy_m: Annotated[tuple[Coordinate, Coordinate], Field(description="shoulder of the left arm in {F}")]
    link_m: Annotated[tuple[Positive, Positive, Positive], Field(description="upper arm, forearm, wrist to grip")]
    joint_limits_deg: Annotated[
        tuple[Degrees, Degrees, Degrees], Field(description="range of each joint of the left arm")
    ]
    handle_x_m: Annotated[float, Field(description="x of the held handle in {F}")]
    retracted_x_m: Annotated[float, Field(description="x of the open, retracted grippers in {F}")]
    grip_half_width_m: Positive
    held_stiffness: tuple[Positive, Positive, Positive]
    held_damping: tuple[Positive, Positive, Positive]
    free_stiffness: tuple[Positive, Positive, Positive]
    free_damping: tuple[Positive, Positive, Positive]
    joint_torque_limit_n_m: Positive
    pushing_force_n: Annotated[NonNegative, Field(description="largest feed-forward force of a push")]
    grip_torque_n_m: Positive
    release_torque_n_m: Annotated[float, Field(lt=0)]
    grip_empty_rad: Annotated[float, Field(description="angle below which the fingers hold nothing")]
    grip_closed_rad: Annotated[float, Field(description="angle below which they hold the handle")]
    grip_open_rad: Annotated[float, Field(description="angle above which they are open")]
    slip_jump_rad: Positive
    contact_force_n: Positive
    connected_force_n: Positive
    inertia_allowance_kg: Annotated[
        NonNegative, Field(description="mass whose acceleration is not taken for contact")
    ]
    collision_torque_n_m: Positive
    collision_rate_n_m_s: Positive
    lift_height_m: NonNegative
    lift_travel_m: Annotated[NonNegative, Field(description="height once the grippers are open")]

    @model_validator(mode="after")
    def _consistent(self) -> ArmsConfig:
        if self.connected_force_n <= self.contact_force_n:
            raise ValueError("connected_force_n must be greater than contact_force_n")
        if not self.grip_empty_rad < self.grip_closed_rad < self.grip_open_rad:
            raise ValueError("grip_empty_rad, grip_closed_rad, grip_open_rad must rise")
        if self.collision_torque_n_m >= self.joint_torque_limit_n_m:
            raise ValueError("collision_torque_n_m must be below joint_torque_limit_n_m, or it can never be reached")
        return self
