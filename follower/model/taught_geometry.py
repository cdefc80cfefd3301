"""The geometry that taught images ask for: the likeliest errors of the configured one under which they are seen.

At the taught pose of docking K the Follower stands at goal K, so the image must be what the geometry gives there.
Where it is not, camera, lens and LEDs are corrected by the least errors, each weighed by its tolerance, that explain
it: the maximum a posteriori of a linearised Gaussian model, iterated. At the goal the features then *are* the taught
ones; elsewhere the correction is the best guess that the tolerances allow.
``docs/decisions/0040-taught-images-correct-the-geometry.md`` says why not otherwise.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from common.config import Config, TaughtConfig, replaced
from common.geometry import Array, Pose2
from follower.estimator.lens import Lens
from follower.model.array import LedArray

SEEN_PX = 0.05  # standard deviation of a taught pixel, averaged over its frames
_ITERATIONS = 6
_STEP = 1e-3  # of a derivative, in standard deviations
_CAMERA = 7  # position, pitch, roll, yaw, focal length
_IMAGE = 5  # pose and tilt of the robot while it was taught


@dataclass(frozen=True)
class TaughtGeometry:
    """What taught images make of a configuration.

    Attributes:
        config: with camera and LEDs corrected.
        goals: where each taught docking ends in it, {L} in {F}: the goal, but for the likeliest error of teaching.
        unexplained_px: largest distance of a taught feature from what the corrected geometry gives.
        sigmas: largest correction, in standard deviations of its tolerance.
    """

    config: Config
    goals: Mapping[int, Pose2]
    unexplained_px: float
    sigmas: float


def corrected(config: Config, images: Mapping[int, Array]) -> TaughtGeometry:
    """Correct a configuration by taught images.

    Args:
        config: the robots.
        images: (n, 2) features by trolley, not levelled, normalised by the lens and mounting of ``config``.
    """
    lens = Lens(config.camera)
    model = _Model(config, tuple(images))
    seen = np.concatenate([lens.to_pixels(image).reshape(-1) for image in images.values()])
    errors = np.zeros(model.size)
    for _ in range(_ITERATIONS):
        slopes = model.slopes(errors)
        missing = seen - model.pixels(errors) + slopes @ errors
        errors = slopes.T @ np.linalg.solve(slopes @ slopes.T + SEEN_PX**2 * np.eye(len(seen)), missing)
    off = (seen - model.pixels(errors)).reshape(-1, 2)
    goals = {trolley: _pose(model.state(errors, row)) for row, trolley in enumerate(images)}
    return TaughtGeometry(
        model.config(errors), goals, float(np.hypot(*off.T).max()), float(np.abs(errors).max(initial=0.0))
    )


class _Model:
    """Pixels of taught dockings as a function of errors, each in standard deviations of its tolerance."""

    def __init__(self, config: Config, trolleys: tuple[int, ...]) -> None:
        self._config = config
        self._goals = [config.docking.goal(trolley) for trolley in trolleys]
        self._leds = len(config.leds.points)
        sigma: TaughtConfig = config.docking.taught
        tilt = sigma.robot_tilt_deg
        camera = [sigma.camera_m] * 3 + [sigma.camera_deg] * 3 + [sigma.focal]
        image = [sigma.pose_m, sigma.pose_m, np.radians(sigma.pose_deg), np.radians(tilt), np.radians(tilt)]
        self._sigmas = np.array(camera + [sigma.leds_m] * 3 * self._leds + image * len(trolleys))
        self.size = len(self._sigmas)

    def config(self, errors: Array) -> Config:
        """The configuration with its errors taken out."""
        camera, values = self._config.camera, self._sigmas * errors
        lens = camera.lens
        scale = 1.0 + float(values[6])
        points = self._config.leds.points + values[_CAMERA : _CAMERA + 3 * self._leds].reshape(-1, 3)
        return replaced(
            self._config,
            camera=replaced(
                camera,
                mount_xyz_m=tuple((camera.mount + values[:3]).tolist()),
                mount_tilt_deg=tuple((np.array(camera.mount_tilt_deg) + values[3:6]).tolist()),
                lens=replaced(lens, fx_px=lens.fx_px * scale, fy_px=lens.fy_px * scale),
            ),
            leds=replaced(self._config.leds, positions_m=tuple(map(tuple, points.tolist()))),
        )

    def state(self, errors: Array, row: int) -> Array:
        """Pose of {L} in {F}, pitch and roll of the camera in one image, (5,)."""
        at = _CAMERA + 3 * self._leds + _IMAGE * row
        state: Array = np.append(self._goals[row].as_array(), (0.0, 0.0))
        state += (self._sigmas * errors)[at : at + _IMAGE]
        return state

    def pixels(self, errors: Array) -> Array:
        """Of all LEDs in all images, (2 n K,)."""
        config = self.config(errors)
        states = np.array([self.state(errors, row) for row in range(len(self._goals))])
        features, _, _ = LedArray(config.leds.points, config.camera.mount).project(states)
        return Lens(config.camera).to_pixels(features.swapaxes(1, 2).reshape(-1, 2)).reshape(-1)

    def slopes(self, errors: Array) -> Array:
        """Derivatives of the pixels by the errors, (2 n K, size)."""
        steps = _STEP * np.eye(self.size)
        columns = [(self.pixels(errors + step) - self.pixels(errors - step)) / (2 * _STEP) for step in steps]
        return np.array(columns).T


def _pose(state: Array) -> Pose2:
    x, y, theta = state[:3].tolist()
    return Pose2(x, y, theta)
