"""What a method is given before a run, and what it then is to the run."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np

from common.config import Config
from common.geometry import Array, Pose2, features_at
from common.messages import DockingState, Mission
from experiments.feature_level.feature_world import FrameMeasurement
from experiments.feature_level.scenes import FRAME_RATE_HZ, NOISE_PX
from follower.controller.interface import Goal, SpeedCaps

Twist = tuple[float, float]
FRAME_S = 1.0 / FRAME_RATE_HZ


@dataclass(frozen=True)
class Task:
    """The robots and the goal."""

    config: Config
    goal_leader_in_follower: Pose2

    @property
    def points_l(self) -> Array:
        """LEDs in {L}, (n, 3)."""
        return self.config.leds.points

    @property
    def camera(self) -> Array:
        """ξ."""
        return self.config.camera.mount

    @cached_property
    def heights(self) -> Array:
        """Δh per point."""
        heights: Array = self.camera[2] - self.points_l[:, 2]
        return heights

    @cached_property
    def desired(self) -> Array:
        """s*, (n, 2)."""
        return self.seen_from(self.goal_leader_in_follower)

    def seen_from(self, relative: Pose2) -> Array:
        """Features (n, 2) from a pose of {L} in {F}."""
        return features_at(self.points_l, relative, self.camera)

    @property
    def servo_goal(self) -> Goal:
        """s* and θ*."""
        return Goal(self.desired, self.goal_leader_in_follower.theta_rad)

    @property
    def sigma(self) -> float:
        """Standard deviation of a normalised coordinate."""
        return NOISE_PX / self.config.camera.lens.fx_px

    @property
    def caps(self) -> SpeedCaps:
        """The configured limits."""
        limits = self.config.limits
        return SpeedCaps(v_min_m_s=limits.v_min_m_s, v_max_m_s=limits.v_max_m_s, w_max_rad_s=limits.w_max_rad_s)

    @cached_property
    def mission(self) -> Mission:
        """Orders of an approach at the configured limits, as the supervisor gives them."""
        limits = self.config.limits
        return Mission(
            phase="approach",
            cause="",
            trolley=1,
            epoch=1,
            armed=True,
            motion="servo",
            straight_speed_m_s=0.0,
            v_max_m_s=limits.v_max_m_s,
            w_max_rad_s=limits.w_max_rad_s,
            goal_theta_rad=self.goal_leader_in_follower.theta_rad,
            desired_features=tuple((float(a), float(b)) for a, b in self.desired),
            grip="closed",
            contact_expected=False,
            resets=0,
        )

    def docking_state(self, now_ns: int, pose: Pose2, disturbance: tuple[float, float, float, float]) -> DockingState:
        """A valid state of the frame taken now, as the estimator publishes it.

        Args:
            now_ns: of the exposure.
            pose: filtered, of {L} in {F}.
            disturbance: speed gain, turn gain, yaw [rad/s], sideways [m/s].
        """
        count = len(self.points_l)
        return DockingState(
            frame_sequence=0,
            capture_ns=now_ns,
            valid=True,
            cause="ok",
            leds_seen=count,
            features=(None,) * count,
            features_filtered=(),
            theta_homography_rad=None,
            x_m=pose.x_m,
            y_m=pose.y_m,
            theta_rad=pose.theta_rad,
            covariance=(0.0,) * 9,
            disturbance=disturbance,
            fit=None,
            fit_covariance=None,
            residual_px=0.0,
            spots=count,
            frames_seen=0,
            frames_dropped=0,
        )


class SolverEndedError(Exception):
    """A solve did not end by itself: the run is over."""


@dataclass
class Insight:
    """What a method estimates, for the figures."""

    disturbance: Array = field(default_factory=lambda: np.zeros(4))
    compensation: Twist = (0.0, 0.0)
    solves: int = 0
    failures: int = 0


class Pilot(Protocol):
    """A method in one run."""

    insight: Insight

    def see(self, measurement: FrameMeasurement, wheels: Twist, applied: Twist) -> None:
        """One frame; ``wheels`` is the twist measured since the last, ``applied`` what was commanded."""

    def command(self, wheels: Twist, applied: Twist) -> Twist:
        """The next command, from all that was seen."""
