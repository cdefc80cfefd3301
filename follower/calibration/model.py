"""What recorded approaches show as a function of the robot's errors, each in standard deviations of its tolerance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from common.config import Config, replaced
from common.geometry import Array
from common.timing import NS_PER_S
from follower.calibration.drive import Drive
from follower.estimator.lens import Lens
from follower.model.array import LedArray

# standard deviations before any drive: as measured with tape and protractor; those of camera and LEDs are configured
_RADIUS, _TRACK = 0.0125, 0.0175
_LATENCY_S, _LATENCY_SIGMA_S = 0.020, 0.015
TILT_RAD = np.radians(0.3)  # the robot's own pitch and roll in one image
_CAMERA = 7
STATE = 5  # of one image: x, y, θ of {L} in {F}, pitch and roll of the robot
_STEP = 1e-3  # of a derivative, in standard deviations
_STATE_STEPS = np.full(STATE, 1e-5)


@dataclass(frozen=True)
class KeyFrames:
    """Images of one drive that enter the fit, and its wheels.

    Attributes:
        times_s: (k,) of the images, from the drive's beginning.
        pixels: (k, n, 2), NaN where not seen.
        start: (k, 5) states at which the fit begins.
        wheel_s, wheel_rad: (m,), (m, 2) measured wheels.
    """

    times_s: Array
    pixels: Array
    start: Array
    wheel_s: Array
    wheel_rad: Array


def key_frames(drive: Drive, config: Config, every_s: float) -> KeyFrames:
    """One image in ``every_s`` of those that lie within the wheels' record.

    Args:
        drive: the approach.
        config: the robots as they were configured in it.
        every_s: time between two of them [s].
    """
    began = int(drive.wheels_ns[0])
    times = (drive.frames_ns - began) / NS_PER_S
    wheel_s = (drive.wheels_ns - began) / NS_PER_S
    inside = np.flatnonzero((times > 0.3) & (times <= wheel_s[-1]) & np.isfinite(drive.features).any(axis=(1, 2)))
    _, first = np.unique(np.floor(times[inside] / every_s), return_index=True)
    kept = inside[first]
    features = drive.features[kept]
    unseen = np.isnan(features)
    flat = np.where(unseen, 0.0, features).reshape(-1, 2)
    pixels = np.where(unseen, np.nan, Lens(config.camera).to_pixels(flat).reshape(features.shape))
    start = np.column_stack([drive.poses[kept], np.zeros((len(kept), 2))])
    return KeyFrames(times[kept], pixels, start, wheel_s, drive.wheel_angle_rad)


class RobotModel:
    """Errors: camera x, y, z, pitch, roll, yaw, focal; LEDs x, y, z each; left and right wheel, track, latency."""

    def __init__(self, config: Config) -> None:
        self._config = config
        leds = len(config.leds.points)
        within = config.docking.taught
        self._wheels = _CAMERA + 3 * leds
        self.names = [f"camera {axis}" for axis in ("x", "y", "z", "pitch", "roll", "yaw")] + ["focal length"]
        self.names += [f"LED {led} {axis}" for led in range(1, leds + 1) for axis in "xyz"]
        self.names += ["left wheel", "right wheel", "track", "latency"]
        self.units = ["m"] * 3 + ["deg"] * 3 + [""] + ["m"] * 3 * leds + ["", "", "", "s"]
        self.sigmas = np.array(
            [within.camera_m] * 3
            + [within.camera_deg] * 3
            + [within.focal]
            + [within.leds_m] * 3 * leds
            + [_RADIUS, _RADIUS, _TRACK, _LATENCY_SIGMA_S]
        )
        self.offsets = np.zeros(len(self.sigmas))
        self.offsets[-1] = _LATENCY_S

    @property
    def size(self) -> int:
        """How many errors."""
        return len(self.sigmas)

    def values(self, errors: Array) -> Array:
        """(size,) errors in their units: true minus configured, relative ones over the configured value.

        Args:
            errors: (size,) in standard deviations.
        """
        return self.offsets + self.sigmas * errors

    def config(self, errors: Array) -> Config:
        """The configuration with its errors taken out. A wheel's radius is corrected by its gear's ratio.

        Args:
            errors: (size,) in standard deviations.
        """
        camera, values = self._config.camera, self.values(errors)
        base, can = self._config.base, self._config.follower_can
        scale = 1.0 + float(values[6])
        lens = replaced(camera.lens, fx_px=camera.lens.fx_px * scale, fy_px=camera.lens.fy_px * scale)
        left, right, track = (1.0 + values[self._wheels : self._wheels + 3]).tolist()
        return replaced(
            self._config,
            camera=replaced(
                camera,
                mount_xyz_m=tuple((camera.mount + values[:3]).tolist()),
                mount_tilt_deg=tuple((np.array(camera.mount_tilt_deg) + values[3:6]).tolist()),
                lens=lens,
            ),
            leds=replaced(self._config.leds, positions_m=tuple(map(tuple, self._points(values).tolist()))),
            base=replaced(base, track_m=base.track_m * track),
            follower_can=replaced(
                can,
                left_wheel=replaced(can.left_wheel, gear_ratio=can.left_wheel.gear_ratio / left),
                right_wheel=replaced(can.right_wheel, gear_ratio=can.right_wheel.gear_ratio / right),
            ),
        )

    def pixels(self, errors: Array, states: Array) -> Array:
        """(k, n, 2) of all LEDs in images from (k, 5) states.

        Args:
            errors: (size,) in standard deviations.
            states: (k, 5) of the images.
        """
        config = self.config(errors)
        features, _, _ = LedArray(config.leds.points, config.camera.mount).project(states)
        flat = features.swapaxes(1, 2).reshape(-1, 2)
        return Lens(config.camera).to_pixels(flat).reshape(len(states), -1, 2)

    def driven(self, errors: Array, keys: KeyFrames) -> Array:
        """(k - 1, 3) motion of {F} from each image to the next in {F} of the first, by the wheels [m, m, rad].

        Latency shifts the light against the wheels: an image shows what was that much earlier.

        Args:
            errors: (size,) in standard deviations.
            keys: the drive.
        """
        left, right, track, late_s = self.values(errors)[self._wheels :]
        base = self._config.base
        rolled = np.diff(keys.wheel_rad, axis=0) * base.wheel_radius_m * [1.0 + left, 1.0 + right]
        turn = (rolled[:, 1] - rolled[:, 0]) / (base.track_m * (1.0 + track))
        heading = np.concatenate([[0.0], np.cumsum(turn)])
        along = rolled.mean(axis=1)
        middle = heading[:-1] + turn / 2
        x = np.concatenate([[0.0], np.cumsum(along * np.cos(middle))])
        y = np.concatenate([[0.0], np.cumsum(along * np.sin(middle))])
        at_s = keys.times_s - late_s
        px, py, theta = (np.interp(at_s, keys.wheel_s, path) for path in (x, y, heading))
        c, s = np.cos(theta[:-1]), np.sin(theta[:-1])
        dx, dy = np.diff(px), np.diff(py)
        return np.column_stack([c * dx + s * dy, c * dy - s * dx, np.diff(theta)])

    def by_errors(self, errors: Array, states: Array, keys: KeyFrames) -> tuple[Array, Array]:
        """Derivatives by the errors: of pixels (k, n, 2, size), of motion (k - 1, 3, size).

        Args:
            errors: (size,) in standard deviations.
            states: (k, 5) of the images.
            keys: the drive.
        """
        pixels, motions = [], []
        for step in _STEP * np.eye(self.size):
            pixels.append((self.pixels(errors + step, states) - self.pixels(errors - step, states)) / (2 * _STEP))
            motions.append((self.driven(errors + step, keys) - self.driven(errors - step, keys)) / (2 * _STEP))
        return np.stack(pixels, axis=-1), np.stack(motions, axis=-1)

    def by_states(self, errors: Array, states: Array) -> Array:
        """Derivatives of the pixels by their image's state, (k, n, 2, 5).

        Args:
            errors: (size,) in standard deviations.
            states: (k, 5) of the images.
        """
        columns = [
            (self.pixels(errors, states + step) - self.pixels(errors, states - step)) / (2 * step.sum())
            for step in np.diag(_STATE_STEPS)
        ]
        return np.stack(columns, axis=-1)

    def _points(self, values: Array) -> Array:
        points: Array = self._config.leds.points + values[_CAMERA : self._wheels].reshape(-1, 3)
        return points


def moved(states: Array, motion: Array) -> tuple[Array, Array, Array]:
    """Where {L} lies after {F} moved, and the derivatives by pose and by motion.

    Args:
        states: (k, ≥ 3) pose of {L} in {F}.
        motion: (k, 3) of {F}, in {F} before it.

    Returns:
        (k, 3) poses, (k, 3, 3) by the pose before, (k, 3, 3) by the motion.
    """
    dx, dy = (states[:, :2] - motion[:, :2]).T
    c, s = np.cos(motion[:, 2]), np.sin(motion[:, 2])
    after = np.column_stack([c * dx + s * dy, c * dy - s * dx, states[:, 2] - motion[:, 2]])
    by_pose = np.zeros((len(states), 3, 3))
    by_pose[:, 0, 0] = by_pose[:, 1, 1] = c
    by_pose[:, 0, 1], by_pose[:, 1, 0] = s, -s
    by_pose[:, 2, 2] = 1.0
    by_motion = -by_pose
    by_motion[:, 0, 2], by_motion[:, 1, 2] = after[:, 1], -after[:, 0]
    return after, by_pose, by_motion
