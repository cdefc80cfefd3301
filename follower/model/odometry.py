"""Odometry: how far {F} went between two measurements of the wheels, with covariance.

From angles, not speeds: nothing is lost between two samples, and a late or dropped one only makes the step longer.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from common.config import BaseConfig
from common.geometry import Array, Pose2
from common.kinematics import arc, path_from_wheels
from common.timing import NS_PER_MS, NS_PER_S

Break = Literal["first", "repeated", "jump"]


@dataclass(frozen=True)
class WheelNoise:
    """What a wheel's angle says wrongly about the floor.

    Attributes:
        slip_m: variance of a wheel's way per metre rolled [m²/m]: it slips a little, at random.
        side_slip_m: the same sideways, of the robot.
        angle_rad: standard deviation of one reading: encoder steps and play.
    """

    slip_m: float = 2e-5
    side_slip_m: float = 2e-5
    angle_rad: float = 2e-4


@dataclass(frozen=True)
class PoseIncrement:
    """The new {F} in the old one, covariance (3, 3) of (x [m], y [m], θ [rad]), and the time in between.

    ``gap``: the samples lay further apart than the bus cycles; where in between the turn was is not known, which
    the covariance holds.
    """

    pose: Pose2
    covariance: Array
    duration_ns: int
    gap: bool

    @property
    def twist(self) -> tuple[float, float]:
        """Mean (v [m/s], ω [rad/s]) of the arc that leads there."""
        half = self.pose.theta_rad / 2
        chord = self.pose.x_m * math.cos(half) + self.pose.y_m * math.sin(half)
        way_m = chord * (half / math.sin(half) if abs(half) > 1e-9 else 1.0)
        duration_s = self.duration_ns / NS_PER_S
        return way_m / duration_s, self.pose.theta_rad / duration_s

    def then(self, following: PoseIncrement) -> PoseIncrement:
        """Both increments as one; their errors are taken as independent.

        Two neighbours share one reading's ``angle_rad``, with opposite signs: this is the cautious side.
        """
        c, s = math.cos(self.pose.theta_rad), math.sin(self.pose.theta_rad)
        x, y = following.pose.x_m, following.pose.y_m
        by_first = np.eye(3)
        by_first[:2, 2] = -s * x - c * y, c * x - s * y
        by_second = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        covariance = by_first @ self.covariance @ by_first.T + by_second @ following.covariance @ by_second.T
        return PoseIncrement(
            self.pose.compose(following.pose),
            covariance,
            self.duration_ns + following.duration_ns,
            self.gap or following.gap,
        )


class WheelOdometry:
    """Feeds on measured wheel angles as they come.

    Args:
        base: wheel radius and track.
        noise: of the wheels.
        max_speed_rad_s: a wheel that seems faster than this was restarted or its encoder jumped.
        gap_ms: samples further apart than this leave a gap.
    """

    def __init__(
        self, base: BaseConfig, noise: WheelNoise = WheelNoise(), max_speed_rad_s: float = 15.0, gap_ms: float = 50.0
    ) -> None:
        self._base, self._noise = base, noise
        self._max_speed_rad_s = max_speed_rad_s
        self._gap_ns = round(gap_ms * NS_PER_MS)
        self._last: tuple[int, tuple[float, float]] | None = None

    def advance(self, measured_ns: int, wheel_angle_rad: tuple[float, float]) -> PoseIncrement | Break:
        """The increment since the last measurement, or why there is none.

        ``first``: nothing to compare with. ``repeated``: not newer than the last one. ``jump``: an angle that no
        wheel can have turned to, or none at all; counting begins anew from the next measurement.
        """
        if not all(map(math.isfinite, wheel_angle_rad)):
            self._last = None
            return "jump"
        if self._last is not None and measured_ns <= self._last[0]:
            return "repeated"
        before, self._last = self._last, (measured_ns, wheel_angle_rad)
        if before is None:
            return "first"
        duration_ns = measured_ns - before[0]
        turned = wheel_angle_rad[0] - before[1][0], wheel_angle_rad[1] - before[1][1]
        if max(map(abs, turned)) > self._max_speed_rad_s * duration_ns / NS_PER_S:
            return "jump"
        return self._increment(turned, duration_ns)

    def _increment(self, turned: tuple[float, float], duration_ns: int) -> PoseIncrement:
        base, noise = self._base, self._noise
        distance, turn = path_from_wheels(base, turned)
        reading = 2.0 * (noise.angle_rad * base.wheel_radius_m) ** 2
        wheels = [noise.slip_m * abs(angle) * base.wheel_radius_m + reading for angle in turned]
        by_wheels = _by_wheels(distance, turn, base.track_m)
        covariance = by_wheels @ np.diag(wheels) @ by_wheels.T
        side = np.array([-math.sin(turn / 2), math.cos(turn / 2), 0.0])
        covariance += noise.side_slip_m * abs(distance) * np.outer(side, side)
        gap = duration_ns > self._gap_ns
        if gap:
            # turned all at the start or all at the end: the way lies within ± half a turn of the chord
            covariance += (distance * turn) ** 2 / 12.0 * np.outer(side, side)
        return PoseIncrement(arc(distance, turn), covariance, duration_ns, gap)


def _by_wheels(distance_m: float, turn_rad: float, track_m: float) -> Array:
    """∂(x, y, θ) by the ways of the left and right wheel [m/m, m/m, rad/m], (3, 2); the chord counts for the arc."""
    c, s = math.cos(turn_rad / 2), math.sin(turn_rad / 2)
    rows = []
    for side in (-1.0, 1.0):
        by_turn = side / track_m
        rows.append([c / 2 - distance_m * s * by_turn / 2, s / 2 + distance_m * c * by_turn / 2, by_turn])
    return np.array(rows).T
