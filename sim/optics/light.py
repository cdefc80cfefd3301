"""The point lights of a scene at one instant: position, beam, strength, and what hides them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.config import LedCodeConfig, LedsConfig
from common.geometry import Array
from common.led_code import CODES, level
from common.timing import NS_PER_MS, NS_PER_S
from sim.optics.scenes import MAINS_HZ, Scene, SecondArray, Walker, Wall

GREY_AT_1_M = 20_000.0  # peak of one LED on its axis, at the reference exposure, gain and current
_TOWARDS_FOLLOWER = np.array([-1.0, 0.0, 0.0])


@dataclass(frozen=True)
class Lights:
    """Points of light in {L}.

    Attributes:
        points: (S, 3) positions [m].
        axes: (S, 3) unit axes of their beams.
        exponent: (S,) of the cosine of the angle to the axis; 0 shines all around.
        grey_at_1_m: (S,) peak grey level on the axis at one metre.
    """

    points: Array
    axes: Array
    exponent: Array
    grey_at_1_m: Array

    def peaks(self, camera_l: Array) -> Array:
        """Peak grey level of each light in the image, (S,): beam over squared distance.

        Args:
            camera_l: (3,) optical centre in {L} [m].
        """
        towards = camera_l - self.points
        square = (towards**2).sum(axis=1)
        on_axis = np.maximum((towards * self.axes).sum(axis=1) / np.sqrt(square), 0.0)
        return np.asarray(self.grey_at_1_m * on_axis**self.exponent / square)

    def with_images(self, images: Lights) -> Lights:
        """These lights followed by others."""
        return Lights(
            np.vstack([self.points, images.points]),
            np.vstack([self.axes, images.axes]),
            np.append(self.exponent, images.exponent),
            np.append(self.grey_at_1_m, images.grey_at_1_m),
        )


def lights_of(leds: LedsConfig, currents_a: tuple[float, ...], scene: Scene, time_s: float) -> Lights:
    """The lights of a scene: LEDs in their order, then other arrays, lamps, and the mirror images of all of them.

    Args:
        leds: positions and beam of the array.
        currents_a: current of each LED [A].
        scene: everything else that shines or mirrors.
        time_s: since the scene began.
    """
    factors = np.array([scene.led_factor(led, time_s) for led in range(len(leds.points))])
    strength = GREY_AT_1_M * factors * np.array(currents_a) / leds.current_a
    exponent = beam_exponent(leds.full_beam_deg)
    axes = np.tile(_TOWARDS_FOLLOWER, (len(leds.points), 1))
    lights = Lights(leds.points, axes, np.full(len(leds.points), exponent), strength)
    for other in scene.others:
        if time_s >= other.start_s:
            lights = lights.with_images(_other_array(other, leds, exponent, time_s))
    if scene.lamps:
        lights = lights.with_images(_lamps(scene, time_s))
    direct = lights
    if scene.floor_reflectance > 0.0:
        lights = lights.with_images(_mirrored(direct, np.array([0.0, 0.0, 1.0]), 0.0, scene.floor_reflectance))
    for wall in scene.walls:
        lights = lights.with_images(_in_wall(direct, wall))
    return lights


def beam_exponent(full_beam_deg: float) -> float:
    """Exponent m of cosᵐ that halves the light at half the full beam."""
    return math.log(0.5) / math.log(math.cos(math.radians(full_beam_deg / 2)))


def hidden(points: Array, camera_l: Array, walkers: tuple[Walker, ...], time_s: float) -> NDArray[np.bool_]:
    """Whether a walker hides each point from the camera.

    Args:
        points: (S, 3) in {L} [m].
        camera_l: (3,) optical centre in {L} [m].
        walkers: of the scene.
        time_s: since the scene began.

    Returns:
        (S,) bool.
    """
    covered = np.zeros(len(points), dtype=np.bool_)
    for walker in walkers:
        since = time_s - walker.start_s
        if since < 0.0:
            continue
        centre = np.array(walker.start_m) + since * np.array(walker.velocity_m_s)
        ray = points[:, :2] - camera_l[:2]
        along = ((centre - camera_l[:2]) * ray).sum(axis=1) / np.maximum((ray**2).sum(axis=1), 1e-9)
        closest = camera_l[:2] + np.clip(along, 0.0, 1.0)[:, None] * ray
        covered |= np.hypot(*(closest - centre).T) < walker.radius_m
    return covered


def _other_array(other: SecondArray, leds: LedsConfig, exponent: float, time_s: float) -> Lights:
    c, s = math.cos(other.pose.theta_rad), math.sin(other.pose.theta_rad)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    shape = leds.points * [1.0, -1.0, 1.0] if other.mirrored else leds.points
    count = len(shape)
    return Lights(
        shape @ turn.T + [other.pose.x_m, other.pose.y_m, 0.0],
        np.tile(turn @ _TOWARDS_FOLLOWER, (count, 1)),
        np.full(count, exponent),
        np.full(count, GREY_AT_1_M * _shown(other.code_offset, leds.code, time_s)),
    )


def _shown(offset: int, code: LedCodeConfig | None, time_s: float) -> float:
    """Level of another array's light, in symbols as long and deep as ours."""
    if code is None:
        return 1.0
    number = (code.number + offset) % CODES
    return level(number, code.symbol_ms * NS_PER_MS, code.depth, round(time_s * NS_PER_S))


def _lamps(scene: Scene, time_s: float) -> Lights:
    count = len(scene.lamps)
    waves = np.array(
        [1.0 - lamp.flicker * math.cos(2 * math.pi * MAINS_HZ * time_s + lamp.phase_rad) ** 2 for lamp in scene.lamps]
    )
    return Lights(
        np.array([lamp.xyz_m for lamp in scene.lamps]),
        np.tile(_TOWARDS_FOLLOWER, (count, 1)),
        np.zeros(count),
        waves * [lamp.grey_at_1_m for lamp in scene.lamps],
    )


def _in_wall(lights: Lights, wall: Wall) -> Lights:
    normal = np.array([math.cos(wall.normal_rad), math.sin(wall.normal_rad), 0.0])
    return _mirrored(lights, normal, wall.distance_m, wall.reflectance)


def _mirrored(lights: Lights, normal: Array, distance_m: float, reflectance: float) -> Lights:
    """Mirror images in the plane n·p = distance."""
    behind = (lights.points @ normal - distance_m)[:, None] * normal
    turned = (lights.axes @ normal)[:, None] * normal
    return Lights(
        lights.points - 2 * behind, lights.axes - 2 * turned, lights.exponent, reflectance * lights.grey_at_1_m
    )
