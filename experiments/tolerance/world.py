"""A robot that is not as configured: drive and light of ``[world.truth]``, at the level of spots in the image.

The pixels are those of :mod:`sim.optics.image` without rendering, with white noise as of a centroid; the wheels
follow with the lag and load of ``[world]``. Not modelled: merged, hidden and false spots, slip, contact (they are in
``davpc sim``).
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from common.config import Config, replaced
from common.geometry import Array, Pose2, move_relative
from common.timing import NS_PER_MS, NS_PER_S
from sim.optics.image import Optics, View
from sim.truth import Truth, true_robots
from sim.world_config import WorldConfig

STEP_S = 1 / 240
SPOT_PX = 0.06  # standard deviation of a spot's centroid: limited by the sensor
_DARK_ROWS = 16  # the optics keep a bank of dark frames, which nothing here reads


class TrueRobot:
    """One robot before one array; time moves by :meth:`advance`. Deterministic for a seed."""

    def __init__(self, config: Config, world: WorldConfig, truth: Truth, start: Pose2, seed: list[int]) -> None:
        errors = truth.drawn(len(config.leds.points))
        true = true_robots(config, errors)
        # only projections are asked for: a bank of dark frames of the whole sensor would cost more than the run
        self._optics = Optics(replaced(true.camera, height_px=_DARK_ROWS), true.leds, seed=0)
        self._last_px = np.array([true.camera.width_px - 1, true.camera.height_px - 1])
        self._lit = (config.leds.current_a,) * len(config.leds.points)
        self._world, self._base = world, config.base
        self._track_m = true.base.track_m
        wheels = (config.follower_can.left_wheel, config.follower_can.right_wheel)
        true_wheels = (true.follower_can.left_wheel, true.follower_can.right_wheel)
        self._rolls = [ours.gear_ratio / theirs.gear_ratio for ours, theirs in zip(wheels, true_wheels, strict=True)]
        self._gain = 1.0 + world.load_gain_per_kg * world.trolley_mass_kg
        self._late_s = errors.latency_ms * 1e-3
        self._random = np.random.default_rng(seed)
        self.follower_in_leader = start
        self.wheels = (0.0, 0.0)
        self.wheel_angle_rad = (0.0, 0.0)
        self._command = (0.0, 0.0)
        self._tilt = [0.0, 0.0]
        self._time_s = 0.0
        self._waiting: deque[tuple[float, tuple[float, float]]] = deque()
        self._past: deque[tuple[float, View]] = deque(maxlen=math.ceil(0.3 / STEP_S))
        self._keep()

    def command(self, twist: tuple[float, float]) -> None:
        """Takes effect after ``base.latency_ms``."""
        self._waiting.append((self._time_s + self._base.latency_ms * NS_PER_MS / NS_PER_S, twist))

    def advance(self, duration_s: float) -> None:
        """Drive on."""
        steps = max(1, round(duration_s / STEP_S))
        for _ in range(steps):
            self._step(duration_s / steps)

    def _step(self, dt_s: float) -> None:
        while self._waiting and self._waiting[0][0] <= self._time_s + 1e-9:
            self._command = self._waiting.popleft()[1]
        world, half = self._world, self._base.track_m / 2
        follow = 1.0 - math.exp(-dt_s / world.wheel_lag_s)
        before = self.wheels[0]
        v, w = (
            now + follow * (self._gain * goal - now) for now, goal in zip(self.wheels, self._command, strict=True)
        )
        self.wheels = (v, w)
        counted = (v - w * half, v + w * half)
        radius = self._base.wheel_radius_m
        self.wheel_angle_rad = (
            self.wheel_angle_rad[0] + counted[0] / radius * dt_s,
            self.wheel_angle_rad[1] + counted[1] / radius * dt_s,
        )
        left, right = (speed * rolls for speed, rolls in zip(counted, self._rolls, strict=True))
        twist = (left + right) / 2, (right - left) / self._track_m
        self.follower_in_leader = move_relative(self.follower_in_leader.inverse(), *twist, dt_s).inverse()
        settle = 1.0 - math.exp(-dt_s / world.suspension_lag_s)
        self._tilt[0] += settle * (world.pitch_per_m_s2 * (v - before) / dt_s - self._tilt[0])
        self._tilt[1] += settle * (world.roll_per_m_s2 * v * w - self._tilt[1])
        self._time_s += dt_s
        self._keep()

    def _keep(self) -> None:
        relative = self.follower_in_leader.inverse()
        view = View(1, relative, self._lit, self._tilt[0], self._tilt[1])
        self._past.append((self._time_s, view))

    def pixels(self) -> Array:
        """Spots (n, 2) of the LEDs in the image that is stamped now; NaN outside it."""
        shown_s = self._time_s - self._late_s
        view = min(self._past, key=lambda kept: abs(kept[0] - shown_s))[1]
        exact = self.seen_from(view.relative, view.pitch_rad, view.roll_rad)
        return exact + SPOT_PX * self._random.standard_normal(exact.shape)

    def seen_from(self, relative: Pose2, pitch_rad: float = 0.0, roll_rad: float = 0.0) -> Array:
        """Exact centroids (n, 2) [px]; NaN outside the image.

        Args:
            relative: pose of {L} in {F}.
            pitch_rad, roll_rad: tilt of the robot, up and right side down.
        """
        found, _ = self._optics.led_truth(View(1, relative, self._lit, pitch_rad, roll_rad))
        inside: NDArray[np.bool_] = np.asarray(((found >= 0.0) & (found <= self._last_px)).all(axis=1))
        return np.where(inside[:, None], found, np.nan)
