"""How often identification is right, silent or wrong: random poses and lamps, no image, no prior."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from common.config import Config
from common.geometry import Array, Pose2
from follower.estimator.identity.identification import Identifier, Limits, Match
from follower.estimator.lens import Lens
from follower.estimator.planar_fit import FitModel
from sim.optics.image import Optics, View
from sim.optics.scenes import Lamp, Scene, SecondArray

NOISE_PX = 0.05
FAINTEST_GREY = 30.0
FARTHEST_M = 9.0


@dataclass(frozen=True)
class LampCase:
    """What is in view beside, or in place of, the array."""

    name: str
    lamps: int
    leds_lit: bool = True
    hidden: bool = False
    mirrored: bool = False


CASES = (
    LampCase("alone", 0),
    LampCase("20 lamps", 20),
    LampCase("40 lamps", 40),
    LampCase("one LED hidden", 0, hidden=True),
    LampCase("one LED hidden, 4 lamps", 4, hidden=True),
    LampCase("no LED, 40 lamps", 40, leds_lit=False),
    LampCase("no LED, 6 lamps", 6, leds_lit=False),
    LampCase("mirrored array, 10 lamps", 10, leds_lit=False, mirrored=True),
)


def identification_rates(config: Config, case: LampCase, frames: int, seed: int) -> dict[str, float]:
    """Per cent of independent scenes that are identified rightly, falsely, or not at all.

    Args:
        config: the robots.
        case: what is in the scenes.
        frames: how many.
        seed: random seed.
    """
    draws = np.random.default_rng((seed, len(case.name), case.lamps))
    optics, lens = Optics(config.camera, config.leds, seed), Lens(config.camera)
    focal = config.camera.lens.fx_px
    model = FitModel(
        config.leds.points, config.camera.mount, config.estimator.pixel_sigma_px / focal, math.radians(0.7)
    )
    identifier = Identifier(model, Limits())
    counts = {"right_percent": 0, "false_percent": 0, "silent_percent": 0}
    for number in range(frames):
        pixels, peaks, leds = _candidates(config, optics, case, draws, number)
        found = identifier.identify(lens.to_normalised(pixels), peaks, allow_partial=True)
        if not isinstance(found, Match):
            counts["silent_percent"] += 1
        elif list(found.spot_of_led) == leds:
            counts["right_percent"] += 1
        else:
            counts["false_percent"] += 1
    return {name: 100.0 * count / frames for name, count in counts.items()}


def _candidates(
    config: Config, optics: Optics, case: LampCase, draws: np.random.Generator, number: int
) -> tuple[Array, Array, list[int]]:
    """Pixels (N, 2) and peaks (N,) of what can be seen, and which of them is each LED (−1: none)."""
    view = _random_view(config, case, draws, number)
    size = (config.camera.width_px, config.camera.height_px)
    seen = [
        speck
        for speck in optics.specks(view)
        if speck.peak > FAINTEST_GREY and 0 <= speck.u_px < size[0] and 0 <= speck.v_px < size[1]
    ]
    order = draws.permutation(len(seen))
    pixels = np.array([(seen[old].u_px, seen[old].v_px) for old in order]).reshape(-1, 2)
    peaks = np.array([seen[old].peak for old in order])
    leds = []
    for point, peak in zip(*optics.led_truth(view), strict=True):
        same = np.flatnonzero((pixels == point).all(axis=1)) if peak > FAINTEST_GREY else np.zeros(0, dtype=np.intp)
        leds.append(int(same[0]) if len(same) else -1)
    return pixels + draws.normal(0.0, NOISE_PX, pixels.shape), peaks, leds


def _random_view(config: Config, case: LampCase, draws: np.random.Generator, number: int) -> View:
    """A pose that the LEDs' beams reach, lamps between and behind the robots, the camera a little tilted."""
    distance, bearing = draws.uniform(1.5, FARTHEST_M), draws.uniform(-0.5, 0.5)
    heading = bearing + draws.uniform(-0.5, 0.5)
    lamps = tuple(
        Lamp(
            (
                float(draws.uniform(2.0 - distance, 8.0)),
                float(draws.uniform(-6.0, 6.0)),
                float(draws.uniform(1.25, 3.0)),
            ),
            float(draws.uniform(6e3, 4e4)),
        )
        for _ in range(case.lamps)
    )
    others = (SecondArray(Pose2(0.0, 0.0, 0.0), mirrored=True),) if case.mirrored else ()
    currents = [config.leds.current_a] * len(config.leds.points)
    if case.hidden:
        currents[int(draws.integers(len(currents)))] = 0.0
    pitch, roll = draws.normal(0.0, math.radians(0.3), 2)
    return View(
        number,
        Pose2(distance * math.cos(bearing), distance * math.sin(bearing), heading),
        tuple(currents),
        float(pitch),
        float(roll),
        scene=Scene("random", leds_lit=case.leds_lit, lamps=lamps, others=others),
    )
