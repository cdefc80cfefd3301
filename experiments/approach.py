"""A Follower that drives up to the array in front of the simulated camera, and what perception made of each frame."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.config import Config
from common.frame_ring import Image
from common.geometry import Array, Pose2, features_at, move_relative, wrap_angle
from follower.estimator.detection import Detection
from follower.estimator.pipeline import Perception
from sim.optics import Optics, View
from sim.scenes import Scene

RATE_HZ = 60.0
PERIOD_NS = round(1e9 / RATE_HZ)
START_M, END_M = 8.0, 1.5
SPEED_M_S = 0.45
WRONG_PX = 3.0
VISIBLE_GREY = 60.0


@dataclass(frozen=True)
class Look:
    """One frame: the view, where the LEDs truly are [px], which shine brightly enough to be seen, the detection."""

    view: View
    leds_px: Array
    visible: NDArray[np.bool_]
    detection: Detection
    wrong_leds: int

    @property
    def false_lock(self) -> bool:
        """Three or more LEDs claimed where they are not, in a frame reported as valid."""
        return self.detection.valid and self.wrong_leds >= 3


def start_pose(draws: np.random.Generator) -> Pose2:
    """Follower in {L}, 8 m behind, off the axis and turned."""
    return Pose2(-START_M, float(draws.uniform(-1.2, 1.2)), math.radians(float(draws.uniform(-15.0, 15.0))))


def steer(follower: Pose2) -> tuple[float, float]:
    """Twist (v, ω) that brings the Follower onto the Leader's axis; smooth, but no docking controller."""
    wanted = -math.atan2(follower.y_m, 2.0)
    turn = float(np.clip(1.5 * wrap_angle(wanted - follower.theta_rad), -0.4, 0.4))
    return SPEED_M_S, turn


def approach(config: Config, optics: Optics, perception: Perception, scene: Scene, seed: int) -> Iterator[Look]:
    """Drive from 8 to 1.5 m; every frame is rendered into one image that lasts until the next."""
    draws = np.random.default_rng((seed, 17))
    follower = start_pose(draws)
    slip = draws.normal(0.0, 0.03, 2)
    image: Image = np.zeros((config.camera.height_px, config.camera.width_px), np.uint8)
    desired = features_at(config.leds.points, config.docking.goal(1), config.camera.mount)
    currents = (config.leds.current_a,) * len(config.leds.points)
    sequence = 0
    while follower.x_m < -END_M and sequence < 1200:
        sequence += 1
        v, w = steer(follower)
        view = View(sequence, follower.inverse(), currents, 0.0, 0.0, v, w, sequence * PERIOD_NS, scene)
        optics.render(image, view)
        measured = (v * (1 + slip[0]) + draws.normal(0, 0.01), w * (1 + slip[1]) + draws.normal(0, 0.01))
        detection = perception.process(image, sequence, sequence * PERIOD_NS, measured, desired)
        leds_px, peaks = optics.led_truth(view)
        yield Look(view, leds_px, np.asarray(peaks > VISIBLE_GREY), detection, wrong_leds(config, detection, leds_px))
        follower = move_relative(follower.inverse(), v, w, 1 / RATE_HZ).inverse()


def wrong_leds(config: Config, detection: Detection, leds_px: Array) -> int:
    """Features that lie more than 3 px from the LED whose they are said to be."""
    used = np.isfinite(detection.features[:, 0])
    pixels = config.camera.pinhole.to_pixels(detection.features[used])
    return int((np.hypot(*(pixels - leds_px[used]).T) > WRONG_PX).sum())
