"""A Follower that drives up to the array in front of the simulated camera, and what the estimator made of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.config import Config
from common.frames.ring import Image
from common.geometry import Array, Pose2, features_at, move_relative, wrap_angle
from common.messages import DockingState, Frame
from follower.estimator.lens import Lens
from follower.estimator.state import StateEstimator
from sim.optics.image import Optics, View
from sim.optics.scenes import Scene

RATE_HZ = 60.0
PERIOD_NS = round(1e9 / RATE_HZ)
START_M, END_M = 8.0, 1.5
SPEED_M_S = 0.45
WRONG_PX = 3.0
VISIBLE_GREY = 60.0


@dataclass(frozen=True)
class Look:
    """One frame: the view, where the LEDs truly are [px], which shine brightly enough to be seen, the state of it."""

    view: View
    leds_px: Array
    visible: NDArray[np.bool_]
    detection: DockingState
    wrong_leds: int

    @property
    def measured(self) -> bool:
        """Whether the frame itself showed the array: a state carried on over it does not count."""
        return self.detection.valid and self.detection.cause == "ok"

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


def stand(follower: Pose2) -> tuple[float, float]:  # noqa: ARG001 - wherever it is
    """No twist."""
    return 0.0, 0.0


def approach(
    config: Config,
    optics: Optics,
    estimator: StateEstimator,
    scene: Scene,
    seed: int,
    drive: Callable[[Pose2], tuple[float, float]] = steer,
) -> Iterator[Look]:
    """Drive from 8 to 1.5 m, 20 s at most; every frame is rendered into one image that lasts until the next.

    Args:
        config: the robots.
        optics: renders the frames.
        estimator: takes them, fresh.
        scene: light and occluders.
        seed: of start and slip.
        drive: twist v [m/s], ω [rad/s] at a pose of {F} in {L}.
    """
    draws = np.random.default_rng((seed, 17))
    follower = start_pose(draws)
    slip = draws.normal(0.0, 0.03, 2)
    image: Image = np.zeros((config.camera.height_px, config.camera.width_px), np.uint8)
    desired = features_at(config.leds.points, config.docking.goal(1), config.camera.mount)
    currents = (config.leds.current_a,) * len(config.leds.points)
    sequence = 0
    while follower.x_m < -END_M and sequence < 1200:
        sequence += 1
        v, w = drive(follower)
        view = View(sequence, follower.inverse(), currents, 0.0, 0.0, v, w, sequence * PERIOD_NS, scene)
        optics.render(image, view)
        measured = (v * (1 + slip[0]) + draws.normal(0, 0.01), w * (1 + slip[1]) + draws.normal(0, 0.01))
        detection = estimator.step(_note(config, sequence), image, measured, desired)
        leds_px, peaks = optics.led_truth(view)
        yield Look(view, leds_px, np.asarray(peaks > VISIBLE_GREY), detection, wrong_leds(config, detection, leds_px))
        follower = move_relative(follower.inverse(), v, w, 1 / RATE_HZ).inverse()


def features_px(config: Config, state: DockingState) -> Array:
    """The state's features in the image (n, 2) [px], through the whole lens; NaN where a LED was not seen."""
    found = np.full((len(state.features), 2), np.nan)
    seen = [led for led, point in enumerate(state.features) if point is not None]
    points = [point for point in state.features if point is not None]
    if points:
        found[seen] = Lens(config.camera).to_pixels(np.array(points))
    return found


def wrong_leds(config: Config, state: DockingState, leds_px: Array) -> int:
    """How many features lie more than 3 px from the LED that they are taken for.

    Args:
        config: the robots.
        state: with the features.
        leds_px: (n, 2) true places.
    """
    away_px = np.hypot(*(features_px(config, state) - leds_px).T)
    return int((away_px[np.isfinite(away_px)] > WRONG_PX).sum())


def _note(config: Config, sequence: int) -> Frame:
    camera = config.camera
    return Frame(
        sequence=sequence,
        slot=0,
        capture_ns=sequence * PERIOD_NS,
        camera_id="simulated",
        width_px=camera.width_px,
        height_px=camera.height_px,
        exposure_us=camera.exposure_us,
        gain=camera.gain,
    )
