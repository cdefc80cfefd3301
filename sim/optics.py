"""What the Follower's camera sees of the Leader's LEDs through its 940 nm filter, as grey levels.

A LED is a speck exp(−|x|/w)·exp(−|y|/w): diamond-shaped level sets as in the paper, and separable, so that its
integral over each pixel is an outer product. Its strength follows the LED's current and beam, exposure and gain,
and one over the squared distance; the sensor clips at 255. Shot noise belongs to the light, read noise comes
from a bank of dark frames.

Not modelled: glow of the filter at steep angles, rolling shutter, hot pixels, lens vignetting and blooming.
This is the plant's own optics: it shares nothing with the estimator's projection but the configuration.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from common.config import CameraConfig, LedsConfig
from common.frame_ring import Image
from common.geometry import Array, Pose2, move_relative
from sim.optics_lens import image_of_rays

_SPECK_PX = 1.3
_GREY_AT_1_M = 20_000.0  # peak of one LED on its axis, at the reference exposure and gain
_REFERENCE_EXPOSURE_US = 600.0
_VISIBLE_GREY = 0.5
_ELECTRONS_PER_GREY = 40.0
_DARK_LEVEL = 5.0
_READ_NOISE = 1.2
_BANK = 6
_BANK_EXTRA_ROWS = 64
_BLUR_STEP_PX = 0.5


@dataclass(frozen=True)
class View:
    """One exposure: its number, pose of {L} in {F}, LED currents, the camera's tilt and the Follower's twist.

    Pitch is positive where the camera looks up, roll where its right side sinks; both away from its mounting.
    """

    frame_sequence: int
    relative: Pose2
    led_currents_a: tuple[float, ...]
    pitch_rad: float = 0.0
    roll_rad: float = 0.0
    v_m_s: float = 0.0
    w_rad_s: float = 0.0


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
        half_beam = math.radians(leds.full_beam_deg / 2)
        self._beam_exponent = math.log(0.5) / math.log(math.cos(half_beam))
        rows = camera.height_px + _BANK_EXTRA_ROWS
        noise = np.random.default_rng(seed).standard_normal((_BANK, rows, camera.width_px), np.float32)
        dark = noise * np.float32(_READ_NOISE * camera.gain**0.5) + np.float32(_DARK_LEVEL)
        self._bank = np.clip(np.rint(dark), 0, 255).astype(np.uint8)

    def render(self, out: Image, view: View) -> None:
        """Write the frame of ``view`` into ``out``, (height, width) uint8.

        Raises:
            ValueError: ``out`` is not of the camera's size.
        """
        height, width = self._camera.height_px, self._camera.width_px
        if out.shape != (height, width):
            raise ValueError(f"frame of {out.shape}, the camera has {(height, width)}")
        draws = np.random.default_rng((self._seed, view.frame_sequence))
        row = int(draws.integers(_BANK_EXTRA_ROWS))
        np.copyto(out, self._bank[view.frame_sequence % _BANK, row : row + height])
        for speck in self.specks(view):
            _draw(out, speck, draws)

    def specks(self, view: View) -> list[Speck]:
        """Specks of the LEDs in front of the camera, also where they lie outside the image."""
        points_c = _to_camera(self._leds.points, view, self._camera.mount)
        moved_c = _to_camera(self._leds.points, _after(view, self._camera.exposure_us * 1e-6), self._camera.mount)
        strength = self._strength(view)
        specks = []
        for point, moved, peak in zip(points_c, moved_c, strength, strict=True):
            if point[2] <= 0.05 or moved[2] <= 0.05 or peak <= _VISIBLE_GREY:
                continue
            before, after = image_of_rays(np.stack([point, moved]), self._camera)
            streak = (float(after[0] - before[0]), float(after[1] - before[1]))
            centre = 0.5 * (before + after)
            specks.append(Speck(float(centre[0]), float(centre[1]), float(peak), streak))
        return specks

    def _strength(self, view: View) -> Array:
        """Peak grey level of each LED, (n,): its axis lies along −x_L whatever the array's tilt."""
        in_l = view.relative.inverse().compose(Pose2(float(self._camera.mount[0]), float(self._camera.mount[1]), 0.0))
        camera_l = np.array([in_l.x_m, in_l.y_m, self._camera.mount[2]])
        towards = camera_l - self._leds.points
        distance = np.sqrt((towards**2).sum(axis=1))
        on_axis = np.maximum(-towards[:, 0] / distance, 0.0)
        exposed = self._camera.exposure_us / _REFERENCE_EXPOSURE_US * self._camera.gain
        current = np.array(view.led_currents_a) / self._leds.current_a
        peaks: Array = _GREY_AT_1_M * exposed * current * on_axis**self._beam_exponent / distance**2
        return peaks


def _to_camera(points_l: Array, view: View, mount_m: Array) -> Array:
    """{L} → {F} → tilted {C} by rotation matrices, (n, 3)."""
    c, s = math.cos(view.relative.theta_rad), math.sin(view.relative.theta_rad)
    f_from_l = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    in_f = points_l @ f_from_l.T + [view.relative.x_m, view.relative.y_m, 0.0]
    c_from_f = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    cp, sp = math.cos(view.pitch_rad), math.sin(view.pitch_rad)
    cr, sr = math.cos(view.roll_rad), math.sin(view.roll_rad)
    pitch = np.array([[1.0, 0.0, 0.0], [0.0, cp, sp], [0.0, -sp, cp]])
    roll = np.array([[cr, sr, 0.0], [-sr, cr, 0.0], [0.0, 0.0, 1.0]])
    in_camera: Array = (in_f - mount_m) @ (roll @ pitch @ c_from_f).T
    return in_camera


def _after(view: View, duration_s: float) -> View:
    """The view at the end of the exposure: {L} moves in {F} against the Follower's twist."""
    moved = move_relative(view.relative, view.v_m_s, view.w_rad_s, duration_s)
    return replace(view, relative=moved)


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
        light += np.outer(along_v, along_u) * (speck.peak / steps)
    patch = out[top:bottom, left:right]
    noise = draws.standard_normal(light.shape) * np.sqrt(light / _ELECTRONS_PER_GREY)
    np.copyto(patch, np.clip(np.rint(patch + light + noise), 0.0, 255.0).astype(np.uint8))


def _pixel_integral(offset_px: Array) -> Array:
    """∫ exp(−|x|/w) dx over the pixel at each offset from the speck's centre."""
    edges = np.append(offset_px - 0.5, offset_px[-1] + 0.5)
    inside = np.exp(-np.abs(edges) / _SPECK_PX)
    below = _SPECK_PX * np.where(edges < 0.0, inside, 2.0 - inside)
    integral: Array = np.diff(below)
    return integral
