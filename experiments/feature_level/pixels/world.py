"""The world at pixel level: the same drive, but every frame is rendered and goes through the whole perception.

The base is that of :mod:`experiments.feature_level.feature_world`, with the wheels' lag as configured; light and
sensor are :mod:`sim.optics.image`. The camera pitches with the acceleration and rolls in bends. A command drives the
wheels ``base.latency_ms`` after the exposure that it comes from. Not modelled: jitter of that latency, lost frames,
noise of the encoders.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from common.config import Config
from common.frames.ring import Image
from common.geometry import Array, Pose2, features_at, move_relative
from common.messages import DockingState, Frame
from common.timing import NS_PER_MS, NS_PER_S
from experiments.feature_level.feature_world import Disturbances, FeatureWorld, FrameMeasurement
from experiments.shared.steady import steady
from follower.estimator.state import StateEstimator
from sim.optics.image import Optics, View
from sim.optics.scenes import CLEAN, Scene
from sim.world_config import WorldConfig, world_config


@dataclass(frozen=True)
class PerceivedFrame(FrameMeasurement):
    """A frame's measurement, and the docking state that the estimator made of it.

    A frame without a valid state, or without θ of the homography, has features and θ of NaN.
    """

    state: DockingState


class PixelWorld:
    """One robot, one array, one camera with its perception. Deterministic for a seed."""

    def __init__(
        self, config: Config, start: Pose2, seed: list[int], disturbances: Disturbances, scene: Scene = CLEAN
    ) -> None:
        cv2.setNumThreads(1)
        world = world_config(config, "pixel level")
        lag_s = disturbances.lag_s or world.wheel_lag_s
        self._config, self._scene = config, scene
        self._base = FeatureWorld(config, start, seed, replace(disturbances, lag_s=lag_s), 0.0, 0.0)
        self._optics = Optics(config.camera, config.leds, int(np.random.SeedSequence(seed).generate_state(1)[0]))
        self._suspension = _Suspension(world)
        self._image: Image = np.zeros((config.camera.height_px, config.camera.width_px), np.uint8)
        self._estimator = StateEstimator(steady(config))
        self._currents = (config.leds.current_a,) * len(config.leds.points)
        self._desired = features_at(config.leds.points, config.docking.goal(1), config.camera.mount)
        self._frames = 0
        self._time_ns = 0
        self._waiting: list[tuple[int, tuple[float, float]]] = []

    @property
    def follower_in_leader(self) -> Pose2:
        """{F} in {L}."""
        return self._base.follower_in_leader

    @property
    def wheels(self) -> tuple[float, float]:
        """Twist that the encoders measure."""
        return self._base.wheels

    @property
    def command(self) -> tuple[float, float]:
        """The command that the wheels follow now."""
        return self._base.command

    @command.setter
    def command(self, twist: tuple[float, float]) -> None:
        effect_ns = self._time_ns + round(self._config.base.latency_ms * NS_PER_MS)
        self._waiting.append((effect_ns, twist))

    def advance(self, duration_s: float) -> None:
        """Drive on; a command still in transit takes over when it is due."""
        until_ns = self._time_ns + round(duration_s * NS_PER_S)
        while self._waiting and self._waiting[0][0] <= until_ns:
            effect_ns, twist = self._waiting.pop(0)
            self._drive_until(effect_ns)
            self._base.command = twist
        self._drive_until(until_ns)

    def _drive_until(self, time_ns: int) -> None:
        duration_s = (time_ns - self._time_ns) / NS_PER_S
        if duration_s <= 0:
            return
        before = self._base.wheels[0]
        self._base.advance(duration_s)
        self._suspension.advance((self._base.wheels[0] - before) / duration_s, self._base.wheels, duration_s)
        self._time_ns = time_ns

    def true_pixels(self) -> Array:
        """Projections (n, 2) of the LEDs, of a level camera, also outside the image; NaN behind the camera."""
        return self._base.true_pixels()

    def in_view(self) -> Array:
        """(n,) whether each projection lies in the image."""
        return self._base.in_view()

    def measure(self, time_ns: int) -> PerceivedFrame:
        """Expose, render, and perceive one frame with its middle at ``time_ns``."""
        self._frames += 1
        self._time_ns = time_ns
        camera = self._config.camera
        v, w = self._base.wheels
        opened = move_relative(self._base.follower_in_leader.inverse(), v, w, -0.5e-6 * camera.exposure_us)
        tilt = self._suspension.pitch_rad, self._suspension.roll_rad
        view = View(self._frames, opened, self._currents, *tilt, v, w, time_ns, self._scene)
        self._optics.render(self._image, view)
        frame = Frame(
            self._frames, 0, time_ns, "simulated", camera.width_px, camera.height_px, camera.exposure_us, camera.gain
        )
        state = self._estimator.step(frame, self._image, (v, w), self._desired)
        features = np.array([(np.nan, np.nan) if point is None else point for point in state.features], dtype=float)
        theta = state.theta_homography_rad
        if not state.valid or theta is None:
            return PerceivedFrame(time_ns, np.full_like(features, np.nan), math.nan, state)
        return PerceivedFrame(time_ns, features, theta, state)


class _Suspension:
    """The chassis sits back when it speeds up, and leans out of a bend."""

    def __init__(self, world: WorldConfig) -> None:
        self._world = world
        self.pitch_rad = self.roll_rad = 0.0

    def advance(self, acceleration_m_s2: float, wheels: tuple[float, float], duration_s: float) -> None:
        world = self._world
        follow = 1.0 - math.exp(-duration_s / world.suspension_lag_s)
        self.pitch_rad += follow * (world.pitch_per_m_s2 * acceleration_m_s2 - self.pitch_rad)
        self.roll_rad += follow * (world.roll_per_m_s2 * wheels[0] * wheels[1] - self.roll_rad)
