"""Both arms: geometry, gains, and what they take for contact."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from common.config.section import NonNegative, Pair, Positive, Section

Degrees = tuple[float, float]


class ArmsConfig(Section):
    """Both SCARA arms, how they hold the handle, and what they take for contact, slip and collision.

    Geometry is the left arm's; the right one is its mirror image. Triples of gains are along the handle's
    x and y [N/m, N·s/m] and about its vertical [N·m/rad, N·m·s/rad], of one arm.
    """

    base_xy_m: Annotated[Pair, Field(description="shoulder of the left arm in {F}")]
    link_m: Annotated[tuple[Positive, Positive, Positive], Field(description="upper arm, forearm, wrist to grip")]
    joint_limits_deg: Annotated[tuple[Degrees, Degrees, Degrees], Field(description="of the left arm")]
    handle_x_m: Annotated[float, Field(description="handle in {F} while held")]
    retracted_x_m: Annotated[float, Field(description="grippers in {F} when they have let go")]
    grip_half_width_m: Positive
    held_stiffness: tuple[Positive, Positive, Positive]
    held_damping: tuple[Positive, Positive, Positive]
    free_stiffness: tuple[Positive, Positive, Positive]
    free_damping: tuple[Positive, Positive, Positive]
    joint_torque_limit_n_m: Positive
    pushing_force_n: Annotated[NonNegative, Field(description="most that is pushed ahead of the handle's yielding")]
    grip_torque_n_m: Positive
    release_torque_n_m: Annotated[float, Field(lt=0)]
    grip_empty_rad: Annotated[float, Field(description="below it the fingers hold nothing")]
    grip_closed_rad: Annotated[float, Field(description="below it they hold the handle")]
    grip_open_rad: Annotated[float, Field(description="above it they have let go")]
    slip_jump_rad: Positive
    contact_force_n: Positive
    connected_force_n: Positive
    inertia_allowance_kg: Annotated[NonNegative, Field(description="force allowed per acceleration before contact")]
    collision_torque_n_m: Positive
    collision_rate_n_m_s: Positive
    lift_height_m: NonNegative
    lift_travel_m: Annotated[NonNegative, Field(description="height when the grippers have let go")]

    @model_validator(mode="after")
    def _consistent(self) -> ArmsConfig:
        if self.connected_force_n <= self.contact_force_n:
            raise ValueError("connected_force_n must be greater than contact_force_n")
        if not self.grip_empty_rad < self.grip_closed_rad < self.grip_open_rad:
            raise ValueError("grip_empty_rad, grip_closed_rad, grip_open_rad must rise")
        if self.collision_torque_n_m >= self.joint_torque_limit_n_m:
            raise ValueError("collision_torque_n_m must be below joint_torque_limit_n_m, or no torque reaches it")
        return self
