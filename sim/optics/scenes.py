"""What the camera sees besides the Leader: lamps, mirrors, sun, people, a second array, and faulty LEDs.

Everything is given in {L}. A scene is plain data, frozen and seeded; :mod:`sim.optics.image` renders it. The named
scenes are those of the paper's real-world experiments, and how they could go wrong.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from common.geometry import Pose2

MAINS_HZ = 50.0
_SHAKEN_AT_M_S = 0.3


@dataclass(frozen=True)
class Lamp:
    """A lamp that emits 940 nm in all directions; it flickers at twice the mains frequency."""

    xyz_m: tuple[float, float, float]
    grey_at_1_m: float
    flicker: float = 0.0
    phase_rad: float = 0.0


@dataclass(frozen=True)
class Wall:
    """A vertical mirror: points with n·p = distance, n = (cos, sin) of ``normal_rad``."""

    normal_rad: float
    distance_m: float
    reflectance: float


@dataclass(frozen=True)
class SunPatch:
    """A bright quadrilateral on floor or wall."""

    corners_m: tuple[tuple[float, float, float], ...]
    grey: float


@dataclass(frozen=True)
class Walker:
    """A pedestrian as an upright cylinder that crosses at constant velocity; hides every light behind."""

    start_m: tuple[float, float]
    velocity_m_s: tuple[float, float]
    start_s: float
    radius_m: float = 0.25


@dataclass(frozen=True)
class LedFault:
    """From ``start_s`` on LED ``led`` has ``factor`` of its strength, all the time or while it blinks."""

    led: int
    factor: float
    start_s: float = 0.0
    blink_hz: float = 0.0


@dataclass(frozen=True)
class SecondArray:
    """Another Leader's array: its pose in {L}, lit from ``start_s`` on.

    Where Leaders have a code, its number is ``code_offset`` after ours.
    """

    pose: Pose2
    start_s: float = 0.0
    mirrored: bool = False
    code_offset: int = 1


@dataclass(frozen=True)
class Scene:
    """A scene. ``shake_rad``: amplitude of the camera's pitch and roll, over time or distance driven."""

    name: str = "clean"
    ambient_grey: float = 0.0
    exposure_factor: float = 1.0
    floor_reflectance: float = 0.0
    shake_rad: tuple[float, float] = (0.0, 0.0)
    leds_lit: bool = True
    lamps: tuple[Lamp, ...] = ()
    walls: tuple[Wall, ...] = ()
    sun: tuple[SunPatch, ...] = ()
    walkers: tuple[Walker, ...] = ()
    faults: tuple[LedFault, ...] = ()
    others: tuple[SecondArray, ...] = ()

    def tilt(self, time_s: float) -> tuple[float, float]:
        """Camera pitch and roll [rad] caused by the floor: two tones each, out of phase."""
        pitch, roll = self.shake_rad
        return (
            pitch * (0.6 * math.sin(2 * math.pi * 1.3 * time_s) + 0.4 * math.sin(2 * math.pi * 3.1 * time_s + 1.0)),
            roll * (0.6 * math.sin(2 * math.pi * 0.9 * time_s + 2.0) + 0.4 * math.sin(2 * math.pi * 2.3 * time_s)),
        )

    def floor_tilt(self, driven_m: float) -> tuple[float, float]:
        """The same tilt [rad] by distance driven: as over time at the speed of an approach."""
        return self.tilt(driven_m / _SHAKEN_AT_M_S)

    def led_factor(self, led: int, time_s: float) -> float:
        """Strength of an LED, relative to what its current gives."""
        factor = 1.0 if self.leds_lit else 0.0
        for fault in self.faults:
            if fault.led == led and time_s >= fault.start_s:
                off = fault.blink_hz == 0.0 or (time_s * fault.blink_hz) % 1.0 < 0.5
                factor *= fault.factor if off else 1.0
        return factor


CLEAN = Scene()


def named_scene(name: str, seed: int = 0) -> Scene:
    """A named scene; ``seed`` draws its details.

    Raises:
        ValueError: no such scene; the text lists those there are.
    """
    if name not in SCENES:
        raise ValueError(f"no scene {name!r}; there are: {', '.join(SCENES)}")
    return SCENES[name](np.random.default_rng((seed, len(name), ord(name[0]))))


def _clean(draws: np.random.Generator) -> Scene:  # noqa: ARG001 - nothing to draw
    return CLEAN


def _dark_outdoor(draws: np.random.Generator) -> Scene:
    """Night, a few distant lamps, an uneven pavement."""
    return Scene("dark_outdoor", shake_rad=_degrees(0.3, 0.2), lamps=_lamps(draws, 3, 0.0, (2.5, 5.0)))


def _parking_lot(draws: np.random.Generator) -> Scene:
    """Underground: flickering tubes overhead, uneven floor."""
    return Scene(
        "parking_lot", ambient_grey=6.0, shake_rad=_degrees(0.6, 0.4), lamps=_lamps(draws, 8, 0.9, (2.2, 2.8))
    )


def _glass_hall(draws: np.random.Generator) -> Scene:
    """Sun through windows, a floor that mirrors, a pane beside the approach."""
    side = float(draws.choice([-1.0, 1.0]))
    x = float(draws.uniform(1.0, 3.0))
    y = -side * float(draws.uniform(1.2, 2.5))
    corners = ((x, y, 0.9), (x, y - side * 0.8, 0.9), (x + 0.3, y - side * 0.8, 1.6), (x + 0.3, y, 1.6))
    return Scene(
        "glass_hall",
        ambient_grey=14.0,
        floor_reflectance=0.35,
        shake_rad=_degrees(0.2, 0.1),
        lamps=_lamps(draws, 4, 0.5, (1.5, 3.0)),
        walls=(Wall(side * math.pi / 2, float(draws.uniform(1.8, 2.6)), 0.5),),
        sun=(SunPatch(corners, 190.0),),
    )


def _clutter40(draws: np.random.Generator) -> Scene:
    """Forty lamps, many at the height of the array."""
    return Scene("clutter40", shake_rad=_degrees(0.2, 0.1), lamps=_lamps(draws, 40, 0.3, (1.25, 3.0)))


def _blocked(draws: np.random.Generator) -> Scene:
    """People walking between the robots."""
    walkers = tuple(
        Walker(
            (float(draws.uniform(-1.4, -0.7)), -1.6),
            (0.0, float(draws.uniform(0.9, 1.4))),
            start_s + float(draws.uniform(0.0, 1.0)),
        )
        for start_s in (1.5, 4.5, 7.5)
    )
    return Scene("blocked", shake_rad=_degrees(0.2, 0.1), walkers=walkers, lamps=_lamps(draws, 5, 0.3, (1.5, 3.0)))


def _dead_led(draws: np.random.Generator) -> Scene:
    """One LED that is dead from the start, fails during the approach, is dim, or blinks."""
    led = int(draws.integers(4))
    kinds = (LedFault(led, 0.0), LedFault(led, 0.0, 4.0), LedFault(led, 0.15, 2.0), LedFault(led, 0.0, 3.0, 1.5))
    fault = kinds[int(draws.integers(len(kinds)))]
    return Scene("dead_led", shake_rad=_degrees(0.2, 0.1), faults=(fault,), lamps=_lamps(draws, 2, 0.3, (2.0, 3.0)))


def _second_leader(draws: np.random.Generator) -> Scene:
    """Another Leader beside this one: lit from the start, or later; or only its mirror image."""
    side = float(draws.choice([-1.0, 1.0]))
    pose = Pose2(
        float(draws.uniform(0.0, 1.0)), side * float(draws.uniform(1.5, 2.5)), float(draws.uniform(-0.3, 0.3))
    )
    kind = int(draws.integers(3))
    other = SecondArray(pose, start_s=0.0 if kind == 0 else 1.0, mirrored=kind == 2)
    return Scene(
        "second_leader", shake_rad=_degrees(0.2, 0.1), others=(other,), lamps=_lamps(draws, 3, 0.3, (2.0, 3.0))
    )


SCENES: dict[str, Callable[[np.random.Generator], Scene]] = {
    "clean": _clean,
    "dark_outdoor": _dark_outdoor,
    "parking_lot": _parking_lot,
    "glass_hall": _glass_hall,
    "clutter40": _clutter40,
    "blocked": _blocked,
    "dead_led": _dead_led,
    "second_leader": _second_leader,
}


def _degrees(pitch_deg: float, roll_deg: float) -> tuple[float, float]:
    return math.radians(pitch_deg), math.radians(roll_deg)


def _lamps(
    draws: np.random.Generator, count: int, flicker: float, heights_m: tuple[float, float]
) -> tuple[Lamp, ...]:
    return tuple(
        Lamp(
            (float(draws.uniform(0.3, 8.0)), float(draws.uniform(-6.0, 6.0)), float(draws.uniform(*heights_m))),
            float(draws.uniform(6_000.0, 40_000.0)),
            flicker * float(draws.uniform(0.3, 1.0)),
            float(draws.uniform(0.0, 2 * math.pi)),
        )
        for _ in range(count)
    )
