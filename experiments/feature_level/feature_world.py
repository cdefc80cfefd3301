"""The world at feature level: a base that drives in the plane and a camera that gives noisy normalised features.

A model of its own: the pose of {F} in {L} is integrated in small steps, the projection is written from the pinhole
geometry again; controllers and observers share nothing with it but the frames. Not modelled: light, spots,
identification, lens distortion, pitch and roll of the camera (the pixel level has them).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from common.config import Config
from common.geometry import Array, Pose2, wrap_angle

STEP_S = 1 / 240
DRIFT_KNEE_M_S = 0.02
STANDING_M_S = 1e-4  # wheels that roll a millimetre in ten seconds stand: friction holds them


@dataclass(frozen=True)
class Pads:
    """Rubber pads between two distances behind the Leader, and what they do to whoever drives over them.

    Attributes:
        from_m, to_m: nearer and farther edge, distance behind the Leader.
        speed_gain, turn_gain: share of the wheels' v and ω that reaches the ground.
        sideways_m_s, yaw_rad_s: drift to the left, and turn, of a robot that is moving.
    """

    from_m: float
    to_m: float
    speed_gain: float = 1.0
    turn_gain: float = 1.0
    sideways_m_s: float = 0.0
    yaw_rad_s: float = 0.0


@dataclass(frozen=True)
class Disturbances:
    """What separates the ground's truth from the command.

    ``load_gain`` and ``lag_s`` act on the wheels, so encoders see them; pads and ``yaw_bias_rad_s`` act between
    wheels and ground, so they do not. Drifts fade to zero below ``drift_knee_m_s``: nothing moves a robot that
    stands. The knee is the world's own, observer and controller have none; at 0 drifts act in full as soon as
    the wheels turn, which is above ``STANDING_M_S``.
    """

    load_gain: float = 1.0
    lag_s: float = 0.0
    yaw_bias_rad_s: float = 0.0
    pads: tuple[Pads, ...] = ()
    drift_knee_m_s: float = DRIFT_KNEE_M_S

    def moving(self, v_m_s: float) -> float:
        """Share of the drifts that acts at a speed, 0 … 1."""
        if self.drift_knee_m_s == 0.0:
            return float(abs(v_m_s) > STANDING_M_S)
        return min(1.0, abs(v_m_s) / self.drift_knee_m_s)


@dataclass(frozen=True)
class FrameMeasurement:
    """What perception gives of one frame: (n, 2) normalised features, NaN where unseen; θ_L^F of the homography."""

    time_ns: int
    features: Array
    theta_rad: float


class FeatureWorld:
    """One robot, one array. Deterministic for a seed; time moves by :meth:`advance`.

    The noise of a frame is drawn again for every ``held_frames``-th one and stays the same in between.
    """

    def __init__(
        self,
        config: Config,
        start: Pose2,
        seed: int | list[int],
        disturbances: Disturbances,
        noise_px: float,
        noise_theta_rad: float,
        held_frames: int = 1,
    ) -> None:
        self._config = config
        self._disturbances = disturbances
        self._noise = (noise_px, noise_theta_rad)
        self._held_frames, self._frames = held_frames, 0
        self._drawn: tuple[Array, float] = np.zeros((len(config.leds.positions_m), 2)), 0.0
        self._random = np.random.default_rng(seed)
        self.follower_in_leader = start
        self.command = (0.0, 0.0)
        self.wheels = (0.0, 0.0)
        self._seen: tuple[Pose2, Array, Array] | None = None

    def advance(self, duration_s: float) -> None:
        """Drive on with the present command."""
        steps = max(1, math.ceil(duration_s / STEP_S - 1e-9))
        for _ in range(steps):
            self._step(duration_s / steps)

    def _step(self, dt_s: float) -> None:
        world = self._disturbances
        follow = 1.0 - math.exp(-dt_s / world.lag_s) if world.lag_s > 0 else 1.0
        v, w = self.wheels
        v += follow * (world.load_gain * self.command[0] - v)
        w += follow * (world.load_gain * self.command[1] - w)
        self.wheels = (v, w)
        moving = world.moving(v)
        forward, sideways, turn = v, 0.0, w + world.yaw_bias_rad_s * moving
        for pads in world.pads:
            if pads.from_m <= -self.follower_in_leader.x_m <= pads.to_m:
                forward *= pads.speed_gain
                turn += (pads.turn_gain - 1.0) * w + pads.yaw_rad_s * moving
                sideways += pads.sideways_m_s * moving
        middle = self.follower_in_leader.theta_rad + turn * dt_s / 2
        c, s = math.cos(middle), math.sin(middle)
        self.follower_in_leader = Pose2(
            self.follower_in_leader.x_m + (c * forward - s * sideways) * dt_s,
            self.follower_in_leader.y_m + (s * forward + c * sideways) * dt_s,
            wrap_angle(self.follower_in_leader.theta_rad + turn * dt_s),
        )

    def true_pixels(self) -> Array:
        """Projections (n, 2) without noise, also outside the image; NaN behind the camera."""
        return self._look()[1].copy()

    def in_view(self) -> Array:
        """(n,) whether each projection lies in the image."""
        return self._look()[2].copy()

    def _look(self) -> tuple[Pose2, Array, Array]:
        """The pose, the projections from it, which lie in the image; kept, since all ask several times a frame."""
        if self._seen is None or self._seen[0] is not self.follower_in_leader:
            pixels = project(self._config, self.follower_in_leader)
            self._seen = self.follower_in_leader, pixels, inside_image(self._config, pixels)
        return self._seen

    def measure(self, time_ns: int) -> FrameMeasurement:
        """One frame; its noise is drawn again, or that of the frame before if the noise is held."""
        noise_px, noise_theta = self._noise
        _, true, inside = self._look()
        if self._frames % self._held_frames == 0:
            self._drawn = self._random.standard_normal(true.shape), self._random.standard_normal()
        self._frames += 1
        noisy = true + noise_px * self._drawn[0]
        noisy[np.logical_not(inside)] = np.nan
        theta = wrap_angle(-self.follower_in_leader.theta_rad + noise_theta * self._drawn[1])
        return FrameMeasurement(time_ns, self._config.camera.pinhole.to_normalised(noisy), theta)


def project(config: Config, pose: Pose2) -> Array:
    """Pixels (n, 2) of the LEDs for a camera on {F} at ``pose`` in {L}; NaN behind the camera.

    In plain floats: for four LEDs that takes a third of the time of array operations, and every frame asks.
    """
    c, s = math.cos(pose.theta_rad), math.sin(pose.theta_rad)
    camera_x, camera_y, camera_z = config.camera.mount_xyz_m
    lens = config.camera.lens
    pixels = []
    for x, y, z in config.leds.positions_m:
        ahead_l, left_l = x - pose.x_m, y - pose.y_m
        depth = c * ahead_l + s * left_l - camera_x
        if depth <= 1e-3:
            depth = math.nan
        left = -s * ahead_l + c * left_l - camera_y
        pixels.append((lens.cx_px - lens.fx_px * left / depth, lens.cy_px + lens.fy_px * (camera_z - z) / depth))
    return np.array(pixels)


def inside_image(config: Config, pixels: Array) -> Array:
    """(n,) whether pixels lie in the image; NaN do not.

    Args:
        config: with the camera.
        pixels: (n, 2) [px].
    """
    size = np.array([config.camera.width_px - 1, config.camera.height_px - 1])
    inside: Array = np.all((pixels >= 0) & (pixels <= size), axis=1)
    return inside
