"""The whole configuration of a pair of robots."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from pydantic import Field, model_validator

from common.config.arms import ArmsConfig
from common.config.can import FollowerCanConfig, LeaderCanConfig
from common.config.control import BaseConfig, ControllerConfig, LimitsConfig
from common.config.docking import DockingConfig, SupervisorConfig
from common.config.leader import LeaderConfig
from common.config.network import NetworkConfig
from common.config.perception import CameraConfig, EstimatorConfig, LedsConfig
from common.config.recorder import RecorderConfig
from common.config.section import Section
from common.geometry import features_at


class Config(Section):
    """The configuration of both robots. The simulation checks its own table, ``world``.

    ``state_directory`` keeps what outlives the processes of a robot: the count of the queue, reports of attempts. If
    empty: systemd's, or the runtime directory.
    """

    state_directory: str = ""
    base: BaseConfig
    camera: CameraConfig
    leds: LedsConfig
    docking: DockingConfig
    estimator: EstimatorConfig
    controller: ControllerConfig
    limits: LimitsConfig
    supervisor: SupervisorConfig
    arms: ArmsConfig
    follower_can: FollowerCanConfig
    leader_can: LeaderCanConfig
    leader: LeaderConfig
    network: NetworkConfig = NetworkConfig()
    recorder: RecorderConfig = RecorderConfig()
    world: Annotated[dict[str, Any], Field(default_factory=dict)]

    @model_validator(mode="after")
    def _fits_together(self) -> Config:
        limits, phases = self.limits, self.supervisor
        if phases.approach_speed_m_s > limits.v_max_m_s:
            raise ValueError("supervisor.approach_speed_m_s is more than limits.v_max_m_s")
        if phases.retract_speed_m_s > -limits.v_min_m_s:
            raise ValueError("supervisor.retract_speed_m_s is more than limits.v_min_m_s allows backwards")
        if not self.leds.current_a <= self.leader.led_rated_current_a <= self.leader.led_max_current_a:
            raise ValueError("leds.current_a ≤ leader.led_rated_current_a ≤ leader.led_max_current_a does not hold")
        if phases.push_limit_m <= self.docking.push_stroke_m:
            raise ValueError("supervisor.push_limit_m must be more than docking.push_stroke_m")
        # the controller steps on every third state
        if abs(self.controller.period_ms * self.camera.rate_hz / 3000.0 - 1.0) > 0.02:
            raise ValueError("controller.period_ms must be three frame periods, 3000 / camera.rate_hz")
        camera = self.camera
        pixels = camera.pinhole.to_pixels(features_at(self.leds.points, self.docking.goal(1), camera.mount))
        inside = (pixels >= 0) & (pixels <= [camera.width_px - 1, camera.height_px - 1])
        if not inside.all():
            raise ValueError("at the goal of trolley 1 an LED lies outside the image: check camera.mount_xyz_m, leds")
        if np.any(np.abs(camera.mount[2] - self.leds.points[:, 2]) < 0.02):
            raise ValueError("an LED is as high as the camera (Δh = 0): its depth cannot be determined")
        return self
