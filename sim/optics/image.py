"""What the Follower's camera sees of the Leader's LEDs through its 940 nm filter, as grey levels.

A LED is a speck exp(−|x|/w)·exp(−|y|/w): diamond-shaped level sets as in the paper, and separable, so that its
integral over each pixel is an outer product. Its strength follows the LED's current and beam, exposure and gain,
and one over the squared distance; the sensor clips at 255. Shot noise belongs to the light, read noise comes
from a bank of dark frames.

Not modelled: glow of the filter at steep angles, rolling shutter, hot pixels, lens vignetting and blooming.
These optics share nothing with the estimator's projection but the configuration.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from common.config import CameraConfig, LedsConfig
from common.frames.ring import Image
from common.geometry import Array, Pose2, move_relative
from sim.optics.lens import image_of_rays
from sim.optics.light import hidden, lights_of
from sim.optics.scenes import CLEAN, Scene

_SPECK_PX = 1.3
_REFERENCE_EXPOSURE_US = 600.0
_VISIBLE_GREY = 0.5
_ELECTRONS_PER_GREY = 40.0
_DARK_LEVEL = 5.0
_READ_NOISE = 1.2
_BANK = 6
_BANK_EXTRA_ROWS = 64
_BLUR_STEP_PX = 0.5
_NEAREST_M = 0.05
_C_FROM_F = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
Images = NDArray[np.uint8]


@dataclass(frozen=True)
class View:
    """One exposure: its number, LED currents, the camera's tilt, the Follower's twist and the scene.

    ``relative`` is the pose of {L} in {F}. Pitch is positive upwards, roll with the right side down; both add to the
    mounting's. ``time_ns`` is the time of the scene's lamps, walkers and faults.
    """

    frame_sequence: int
    relative: Pose2
    led_currents_a: tuple[float, ...]
    pitch_rad: float = 0.0
    roll_rad: float = 0.0
    v_m_s: float = 0.0
    w_rad_s: float = 0.0
    time_ns: int = 0
    scene: Scene = CLEAN


@dataclass(frozen=True)
class Speck:
    """A point of light on the sensor: centre [px], peak [grey levels], streak during the exposure [px]."""

    u_px: float
    v_px: float
    peak: float
    streak_px: tuple[float, float]


class Optics:
    """Renders the camera's frames; the same seed and frame sequence give the same pixels."""

    def __init__(self, camera: CameraConfig, leds: LedsConfig, seed: int) -> None:
        self._camera = camera
        self._leds = leds
        self._seed = seed
        rows = camera.height_px + _BANK_EXTRA_ROWS
        noise = np.random.default_rng(seed).standard_normal((_BANK, rows, camera.width_px), np.float32)
        dark = noise * np.float32(_READ_NOISE * camera.gain**0.5) + np.float32(_DARK_LEVEL)
        self._banks: dict[float, Images] = {0.0: np.clip(np.rint(dark), 0, 255).astype(np.uint8)}

    def render(self, out: Image, view: View) -> None:
        """Render a frame.

        Args:
            out: (height, width) uint8, written in place.
            view: the exposure.

        Raises:
            ValueError: ``out`` is not of the camera's size.
        """
        height, width = self._camera.height_px, self._camera.width_px
        if out.shape != (height, width):
            raise ValueError(f"frame of {out.shape}, the camera has {(height, width)}")
        draws = np.random.default_rng((self._seed, view.frame_sequence))
        row = int(draws.integers(_BANK_EXTRA_ROWS))
        np.copyto(out, self._bank(view.scene)[view.frame_sequence % _BANK, row : row + height])
        self._sunlit(out, view)
        for speck in self.specks(view):
            _draw(out, speck, draws)

    def specks(self, view: View) -> list[Speck]:
        """Specks of all unobstructed lights in front of the camera, including those outside the image."""
        start, end, peaks = self._lit(view)
        centre, streak = 0.5 * (start + end), end - start
        return [
            Speck(float(c[0]), float(c[1]), float(peak), (float(s[0]), float(s[1])))
            for c, s, peak in zip(centre, streak, peaks, strict=True)
            if peak > _VISIBLE_GREY
        ]

    def led_truth(self, view: View) -> tuple[Array, Array]:
        """True image of each LED: pixels (n, 2), and peak (n,) [grey levels], 0 if it is not visible."""
        start, end, peaks = self._lit(view)
        leds = len(self._leds.points)
        pixels = 0.5 * (start + end)[:leds]
        limits = [self._camera.width_px - 1, self._camera.height_px - 1]
        inside = ((pixels >= 0.0) & (pixels <= limits)).all(axis=1)
        return pixels, np.where(inside, peaks[:leds], 0.0)

    def _lit(self, view: View) -> tuple[Array, Array, Array]:
        """Pixels of each light at begin and end of the exposure, and its peak: 0 if hidden or behind the camera."""
        time_s = view.time_ns * 1e-9
        lights = lights_of(self._leds, view.led_currents_a, view.scene, time_s)
        mount = self._camera.mount
        camera_in_leader = view.relative.inverse().compose(Pose2(float(mount[0]), float(mount[1]), 0.0))
        camera_l = np.array([camera_in_leader.x_m, camera_in_leader.y_m, mount[2]])
        exposed = self._camera.exposure_us / _REFERENCE_EXPOSURE_US * self._camera.gain * view.scene.exposure_factor
        peaks = lights.peaks(camera_l) * exposed
        if view.scene.walkers:
            peaks = np.where(hidden(lights.points, camera_l, view.scene.walkers, time_s), 0.0, peaks)
        turn = _camera_attitude(view, self._camera)
        before = _to_camera(lights.points, view.relative, self._camera, turn)
        after = _to_camera(lights.points, self._after(view), self._camera, turn)
        peaks = np.where((before[:, 2] > _NEAREST_M) & (after[:, 2] > _NEAREST_M), peaks, 0.0)
        for points in (before, after):
            points[:, 2] = np.maximum(points[:, 2], _NEAREST_M)
        return image_of_rays(before, self._camera), image_of_rays(after, self._camera), peaks

    def _after(self, view: View) -> Pose2:
        """Pose of {L} in {F} at the end of the exposure."""
        return move_relative(view.relative, view.v_m_s, view.w_rad_s, self._camera.exposure_us * 1e-6)

    def _bank(self, scene: Scene) -> Images:
        """The dark frames with the scene's ambient light added; made once for each level."""
        if scene.ambient_grey not in self._banks:
            self._banks[scene.ambient_grey] = np.stack(
                [cv2.add(dark, np.full(1, scene.ambient_grey)) for dark in self._banks[0.0]]
            ).astype(np.uint8)
        return self._banks[scene.ambient_grey]

    def _sunlit(self, out: Image, view: View) -> None:
        """Sun patches in front of the camera, in place."""
        for patch in view.scene.sun:
            turn = _camera_attitude(view, self._camera)
            corners = _to_camera(np.array(patch.corners_m), view.relative, self._camera, turn)
            if np.any(corners[:, 2] < 0.3):
                continue
            pixels = np.rint(image_of_rays(corners, self._camera)).astype(np.int32)
            cv2.fillConvexPoly(out, np.clip(pixels, -8000, 8000), patch.grey)


def _camera_attitude(view: View, camera: CameraConfig) -> Array:
    """Rotation {C} from {F} of the mounted and shaken camera, (3, 3)."""
    shake_pitch, shake_roll = view.scene.tilt(view.time_ns * 1e-9)
    shaken = _attitude(view.pitch_rad + shake_pitch, view.roll_rad + shake_roll, 0.0)
    mounted = _attitude(*camera.mount_tilt.tolist())
    attitude: Array = mounted @ shaken @ _C_FROM_F
    return attitude


def _to_camera(points_l: Array, relative: Pose2, camera: CameraConfig, attitude: Array) -> Array:
    """{L} → {F} → {C} by rotation matrices, (n, 3)."""
    c, s = math.cos(relative.theta_rad), math.sin(relative.theta_rad)
    f_from_l = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    in_f = points_l @ f_from_l.T + [relative.x_m, relative.y_m, 0.0]
    in_camera: Array = (in_f - camera.mount) @ attitude.T
    return in_camera


def _attitude(pitch_rad: float, roll_rad: float, yaw_rad: float) -> Array:
    """Rotation into a camera that is yawed to the left, then pitched up, then rolled right side down, (3, 3)."""
    cp, sp = math.cos(pitch_rad), math.sin(pitch_rad)
    cr, sr = math.cos(roll_rad), math.sin(roll_rad)
    cy, sy = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.array(
        [
            [cr * cy - sr * sp * sy, sr * cp, cr * sy + sr * sp * cy],
            [-sr * cy - cr * sp * sy, cr * cp, cr * sp * cy - sr * sy],
            [-cp * sy, -sp, cp * cy],
        ]
    )


def _draw(out: Image, speck: Speck, draws: np.random.Generator) -> None:
    """Add one speck with its shot noise, in place."""
    radius = _SPECK_PX * math.log(speck.peak / _VISIBLE_GREY) + 1.0
    reach_u = radius + abs(speck.streak_px[0]) / 2
    reach_v = radius + abs(speck.streak_px[1]) / 2
    height, width = out.shape
    left, right = max(math.floor(speck.u_px - reach_u), 0), min(math.ceil(speck.u_px + reach_u) + 1, width)
    top, bottom = max(math.floor(speck.v_px - reach_v), 0), min(math.ceil(speck.v_px + reach_v) + 1, height)
    if left >= right or top >= bottom:
        return
    columns, rows = np.arange(left, right), np.arange(top, bottom)
    steps = 1 + int(math.hypot(*speck.streak_px) / _BLUR_STEP_PX)
    light = np.zeros((len(rows), len(columns)))
    for k in range(steps):
        part = (k + 0.5) / steps - 0.5
        along_u = _pixel_integral(columns - (speck.u_px + part * speck.streak_px[0]))
        along_v = _pixel_integral(rows - (speck.v_px + part * speck.streak_px[1]))
        light += along_v[:, None] * along_u * (speck.peak / steps)
    patch = out[top:bottom, left:right]
    noise = draws.standard_normal(light.shape)
    noise *= np.sqrt(light / _ELECTRONS_PER_GREY)
    light += patch
    light += noise
    np.rint(light, out=light)
    np.maximum(light, 0.0, out=light)
    np.minimum(light, 255.0, out=light)
    patch[:] = light


def _pixel_integral(offset_px: Array) -> Array:
    """∫ exp(−|x|/w) dx over the pixel at each offset from the speck's centre."""
    edges = np.empty(len(offset_px) + 1)
    np.subtract(offset_px, 0.5, out=edges[:-1])
    edges[-1] = offset_px[-1] + 0.5
    below = np.exp(np.abs(edges) / -_SPECK_PX)
    after = edges >= 0.0
    below[after] = 2.0 - below[after]
    below *= _SPECK_PX
    integral: Array = below[1:] - below[:-1]
    return integral
