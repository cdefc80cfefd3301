"""Where a trolley docks, and the phases of a docking."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from common.ceilings import PHASE_CAPS
from common.config.section import Positive, Section
from common.geometry import Pose2


class TaughtConfig(Section):
    """How far the geometry may be from the robots' (standard deviations): what taught images may correct."""

    camera_m: Annotated[Positive, Field(description="optical centre, along each axis of {F}")] = 0.005
    camera_deg: Annotated[Positive, Field(description="pitch, roll and yaw of the mounting")] = 0.6
    focal: Annotated[Positive, Field(description="of the focal length, relative")] = 0.006
    leds_m: Annotated[Positive, Field(description="each LED along each axis of {L}")] = 0.0015
    pose_m: Annotated[Positive, Field(description="x and y of the taught pose")] = 0.001
    pose_deg: Annotated[Positive, Field(description="θ of the taught pose")] = 0.05
    robot_tilt_deg: Annotated[Positive, Field(description="pitch and roll of the robot at a taught pose")] = 0.1


class DockingConfig(Section):
    """Where trolley K docks, and when the approach counts as arrived.

    ``taught_dir`` holds the images of ``davpc teach K``, by which camera and LEDs are corrected within ``taught``; if
    empty, the geometry counts as configured.
    """

    goal_distance_m: Positive
    trolley_pitch_m: Positive
    staging_distance_m: Annotated[
        float, Field(gt=0, le=5, description="behind goal K, where the Follower takes up a trolley")
    ]
    feature_tolerance: Positive
    heading_tolerance_deg: Positive
    settle_s: Positive
    push_stroke_m: Positive
    lateral_bound_first_m: Positive
    lateral_bound_next_m: Positive
    taught_dir: str = ""
    taught: TaughtConfig = TaughtConfig()

    def goal(self, trolley: int) -> Pose2:
        """Desired pose of {L} in {F} for docking ``trolley`` (1 is the first)."""
        return Pose2(self.goal_distance_m + self.trolley_pitch_m * (trolley - 1), 0.0, 0.0)


class SupervisorConfig(Section):
    """Phases of a docking: speeds, distances and time limits."""

    approach_speed_m_s: Annotated[float, Field(gt=0, le=PHASE_CAPS["approach"].v_m_s)]
    last_metre_speed_m_s: Annotated[float, Field(gt=0, le=0.2)]
    insert_speed_m_s: Annotated[float, Field(gt=0, le=PHASE_CAPS["insert"].v_m_s)]
    push_speed_m_s: Annotated[float, Field(gt=0, le=PHASE_CAPS["push"].v_m_s)]
    push_limit_m: Positive
    retract_speed_m_s: Annotated[float, Field(gt=0, le=PHASE_CAPS["retract"].v_m_s)]
    retract_distance_m: Positive
    manual_speed_m_s: Annotated[
        float, Field(gt=0, le=PHASE_CAPS["manual"].v_m_s, description="limit of the operator's commands")
    ] = 0.10
    manual_turn_rad_s: Annotated[float, Field(gt=0, le=PHASE_CAPS["manual"].w_rad_s)] = 0.30
    acquire_timeout_s: Positive
    approach_timeout_s: Positive
    lost_timeout_s: Positive
    stall_timeout_s: Annotated[Positive, Field(description="of an approach without progress")]
    lock_timeout_s: Annotated[float, Field(gt=0, le=60)]
    link_timeout_s: Annotated[float, Field(gt=0, le=60, description="wait for the Leader, in contact")]
    trolley_wait_s: Annotated[float, Field(gt=0, description="standstill before the grippers close")]
    grip_timeout_s: Positive
    trolley_timeout_s: Positive
    search_turn_deg: Annotated[float, Field(gt=0, le=45, description="angle to each side")]
    search_rate_rad_s: Annotated[float, Field(gt=0, le=PHASE_CAPS["search"].w_rad_s)]
    search_clearance_m: Annotated[
        float, Field(ge=0.3, description="least distance to the goal for turning with a trolley")
    ]
    reduced_speed_m_s: Annotated[float, Field(gt=0, le=0.1, description="while an LED is missing")]
    reduced_sigma_m: Annotated[
        float, Field(gt=0, le=0.05, description="largest predicted σ of e_y at the goal, with an LED missing")
    ]
    push_visual_tolerance_m: Positive
