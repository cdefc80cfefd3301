"""Parameters of the simulated world: the table ``[world]`` of the configuration, read by the simulation only."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field, field_validator, model_validator

from common.config import Config, NonNegative, Positive, Section, validate
from common.errors import ConfigError
from common.geometry import Pose2, pose_from_paper_start
from sim.optics.scenes import named_scene
from sim.truth import Truth, check_truth

_LEADER_HALF_WIDTH_M = 0.5
_FARTHEST_M = 100.0


class WorldConfig(Section):
    """Plant, trolley, guide and servers of the simulated backend."""

    seed: Annotated[int, Field(ge=0)]
    start: Annotated[
        tuple[float, float, float],
        Field(description="Follower at the start: distance behind the Leader [m], y [m], heading [°]"),
    ]
    wheel_lag_s: Annotated[float, Field(gt=0, le=1)] = 0.10
    load_gain_per_kg: Annotated[float, Field(gt=-0.02, le=0)] = -0.0067
    docked: Annotated[int, Field(ge=0, le=30, description="trolleys already locked in the queue")] = 0
    docked_error_m: Annotated[float, Field(ge=0, le=0.1, description="largest lateral error of those trolleys")] = (
        0.01
    )
    trolley_mass_kg: Positive = 15.0
    trolley_load_kg: Annotated[float, Field(ge=0, le=60, description="largest load of a trolley; drawn for each")] = (
        0.0
    )
    rolling_resistance: NonNegative = 0.02
    caster_trail_m: Positive = 0.04
    caster_friction: Annotated[
        float, Field(ge=0, le=0.3, description="sideways friction over the load of a caster")
    ] = 0.05
    caster_start_rad: Annotated[
        float, Field(ge=0, le=3.2, description="largest initial caster angle of a new trolley")
    ] = 1.5
    place_error: Annotated[
        tuple[NonNegative, NonNegative, NonNegative], Field(description="largest error of a new handle: m, m, rad")
    ] = (0.010, 0.010, 0.0175)
    nest_m: Annotated[Positive, Field(description="depth of a beam in the mouth of the trolley ahead")] = 0.10
    nest_force_n: Annotated[NonNegative, Field(description="friction at full depth")] = 12.0
    nest_stiffness_n_m: Positive = 100_000.0
    nest_play_m: Annotated[
        float, Field(ge=0, le=0.05, description="largest distance that a nested trolley rolls back")
    ] = 0.02
    handle_x_m: Positive = 0.45
    handle_to_beam_m: Positive = 0.90
    joint_inertia_kg_m2: tuple[Positive, Positive, Positive] = (0.15, 0.10, 0.03)
    joint_friction_n_m: NonNegative = 0.35
    joint_damping_n_m_s: NonNegative = 0.6
    joint_torque_error: Annotated[float, Field(ge=-0.2, le=0.2, description="relative error of a joint's torque")] = (
        0.02
    )
    torque_noise_n_m: NonNegative = 0.05
    link_error: Annotated[float, Field(ge=-0.05, le=0.05, description="relative error of the link lengths")] = 0.002
    finger_friction_n_per_n_m: Annotated[
        Positive, Field(description="pull per grip torque at which the handle slips")
    ] = 20.0
    traction_limit_n: Positive = 220.0
    guide_ramp_m: tuple[float, float] = (-0.10, 0.0)
    guide_force_n: Positive = 45.0
    stop_stiffness_n_m: Positive = 40_000.0
    lock_travel_s: Positive = 1.5
    scene: str = "clean"
    pitch_per_m_s2: Annotated[float, Field(ge=0, le=0.05, description="camera pitch per acceleration [rad]")] = 0.004
    roll_per_m_s2: Annotated[
        float, Field(ge=0, le=0.05, description="camera roll per centripetal acceleration [rad]")
    ] = 0.004
    suspension_lag_s: Positive = 0.15
    can_server_fd: int = -1
    truth: Annotated[Truth, Field(description="errors of the configuration that no process of the robots has")] = (
        Truth()
    )

    @field_validator("scene")
    @classmethod
    def _known_scene(cls, name: str) -> str:
        named_scene(name)
        return name

    @model_validator(mode="after")
    def _start_before_the_guide(self) -> WorldConfig:
        begin, end = self.guide_ramp_m
        if begin >= end:
            raise ValueError("guide_ramp_m: the begin must be less than the end")
        beam = self.start_pose.compose(Pose2(self.handle_x_m + self.handle_to_beam_m, 0.0, 0.0))
        if beam.x_m > begin and abs(beam.y_m) < _LEADER_HALF_WIDTH_M:
            raise ValueError(f"start: the trolley's front beam would be {beam.x_m - begin:.2f} m inside the Leader")
        if max(abs(self.start[0]), abs(self.start[1])) > _FARTHEST_M:
            raise ValueError(f"start: more than {_FARTHEST_M:.0f} m away from the Leader")
        return self

    @property
    def start_pose(self) -> Pose2:
        """Pose of {F} in {L} at the start."""
        x_m, y_m, theta_deg = self.start
        return pose_from_paper_start(x_m, y_m, math.radians(theta_deg))


def world_config(config: Config, origin: str) -> WorldConfig:
    """The checked ``[world]`` table.

    Raises:
        ConfigError: it is missing or wrong.
    """
    world = validate(WorldConfig, config.world, f"{origin}: [world]")
    check_truth(world.truth, config, origin)
    beam = world.start_pose.compose(Pose2(world.handle_x_m + world.handle_to_beam_m, 0.0, 0.0))
    mouth_m = world.guide_ramp_m[1] - config.docking.trolley_pitch_m * world.docked - world.nest_m
    if (
        world.docked
        and beam.x_m > mouth_m - world.docked * world.nest_play_m
        and abs(beam.y_m) < _LEADER_HALF_WIDTH_M
    ):
        raise ConfigError(f"{origin}: [world]: start: the trolley would overlap the queue of {world.docked}")
    return world
