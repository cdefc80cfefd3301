"""Truth apart from belief: what of the robots differs from their configuration, in the simulated world alone.

The table ``[world.truth]`` holds errors set by hand, and tolerances from which more are drawn for a seed; both add
up. The world builds light and drive from :func:`true_robots`; every process of the robots goes on with the
configuration as written. Without an error the configuration itself is used: exact geometry stays exact to the bit.

Not modelled: the turning of LED beams with a tilted Leader, gravity along a slope, errors of the arms
(``world.link_error``), errors that change during a run.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from pydantic import Field

from common.config import Config, DriveConfig, LensConfig, Section, replaced
from common.errors import ConfigError
from common.geometry import Array
from common.timing import NS_PER_MS

Length = Annotated[float, Field(ge=-0.2, le=0.2)]
Degrees = Annotated[float, Field(ge=-20.0, le=20.0)]
Relative = Annotated[float, Field(ge=-0.3, le=0.3)]
Millis = Annotated[float, Field(ge=0.0, le=250.0)]


class Tolerances(Section):
    """Largest error of each kind; errors are drawn evenly up to it, to both sides, latency from zero."""

    camera_m: Annotated[float, Field(ge=0, le=0.2, description="optical centre, along each axis of {F}")] = 0.0
    camera_deg: Annotated[float, Field(ge=0, le=20, description="each of pitch, roll and yaw")] = 0.0
    focal: Annotated[float, Field(ge=0, le=0.3, description="relative")] = 0.0
    centre_px: Annotated[float, Field(ge=0, le=100)] = 0.0
    distortion: Annotated[float, Field(ge=0, le=0.05, description="of the coefficient of r²")] = 0.0
    leds_m: Annotated[float, Field(ge=0, le=0.2, description="each LED along each axis of {L}")] = 0.0
    leader_tilt_deg: Annotated[float, Field(ge=0, le=20, description="pitch and roll of the Leader")] = 0.0
    leader_height_m: Annotated[float, Field(ge=0, le=0.2)] = 0.0
    wheel_radius: Annotated[float, Field(ge=0, le=0.3, description="relative, each wheel")] = 0.0
    track: Annotated[float, Field(ge=0, le=0.3, description="relative")] = 0.0
    gear: Annotated[float, Field(ge=0, le=0.3, description="relative, each wheel")] = 0.0
    encoder: Annotated[float, Field(ge=0, le=0.3, description="relative, each wheel")] = 0.0
    latency_ms: Millis = 0.0


class Truth(Section):
    """Errors of the configuration: true value minus configured one, relative ones over it; ``[world.truth]``.

    ``camera_tilt_deg`` are pitch (up), roll (right side down) and yaw (to the left), ``leader_tilt_deg`` pitch (its
    front up) and roll (right side down) about the origin of {L}; wheels are left, right.
    """

    camera_m: tuple[Length, Length, Length] = (0.0, 0.0, 0.0)
    camera_tilt_deg: tuple[Degrees, Degrees, Degrees] = (0.0, 0.0, 0.0)
    focal: Relative = 0.0
    centre_px: tuple[
        Annotated[float, Field(ge=-100, le=100)], Annotated[float, Field(ge=-100, le=100)]
    ] = (0.0, 0.0)  # fmt: skip
    distortion: Annotated[float, Field(ge=-0.05, le=0.05, description="of the coefficient of r²")] = 0.0
    leds_m: Annotated[
        tuple[tuple[Length, Length, Length], ...], Field(description="one for each LED, or none")
    ] = ()  # fmt: skip
    leader_tilt_deg: tuple[Degrees, Degrees] = (0.0, 0.0)
    leader_height_m: Length = 0.0
    wheel_radius: tuple[Relative, Relative] = (0.0, 0.0)
    track: Relative = 0.0
    gear: tuple[Relative, Relative] = (0.0, 0.0)
    encoder: tuple[Relative, Relative] = (0.0, 0.0)
    latency_ms: Annotated[
        float, Field(ge=0, le=250, description="of the light before the middle of the exposure that is reported")
    ] = 0.0
    seed: Annotated[int, Field(ge=0, description="of what is drawn from the tolerances")] = 0
    tolerances: Tolerances = Tolerances()

    def drawn(self, leds: int) -> Truth:
        """These errors and those drawn for the seed, without tolerances; each kind has a stream of its own.

        Args:
            leds: how many the array has.
        """
        within = self.tolerances
        if within == Tolerances():
            return self

        def errors(kind: str, by_hand: Array) -> Array:
            bound = getattr(within, kind)
            stream = np.random.default_rng([self.seed, list(Tolerances.model_fields).index(kind)])
            drawn: Array = by_hand + bound * stream.uniform(-1.0, 1.0, by_hand.shape)
            return drawn

        def pair(kind: str, by_hand: tuple[float, ...]) -> tuple[float, ...]:
            return tuple(errors(kind, np.array(by_hand)).tolist())

        by_hand = np.array(self.leds_m) if self.leds_m else np.zeros((leds, 3))
        waiting = np.random.default_rng([self.seed, len(Tolerances.model_fields)]).uniform(0.0, within.latency_ms)
        return self.model_copy(
            update={
                "camera_m": pair("camera_m", self.camera_m),
                "camera_tilt_deg": pair("camera_deg", self.camera_tilt_deg),
                "focal": float(errors("focal", np.array(self.focal))),
                "centre_px": pair("centre_px", self.centre_px),
                "distortion": float(errors("distortion", np.array(self.distortion))),
                "leds_m": tuple(tuple(row) for row in errors("leds_m", by_hand).tolist()),
                "leader_tilt_deg": pair("leader_tilt_deg", self.leader_tilt_deg),
                "leader_height_m": float(errors("leader_height_m", np.array(self.leader_height_m))),
                "wheel_radius": pair("wheel_radius", self.wheel_radius),
                "track": float(errors("track", np.array(self.track))),
                "gear": pair("gear", self.gear),
                "encoder": pair("encoder", self.encoder),
                "latency_ms": self.latency_ms + float(waiting),
                "tolerances": Tolerances(),
            }
        )

    @property
    def latency_ns(self) -> int:
        """Age of the light in each image beyond its stamp."""
        return round(self.latency_ms * NS_PER_MS)


def check_truth(truth: Truth, config: Config, origin: str) -> None:
    """Check it against the robots.

    Raises:
        ConfigError: not one error for each LED.
    """
    leds = len(config.leds.positions_m)
    if truth.leds_m and len(truth.leds_m) != leds:
        raise ConfigError(f"{origin}: [world.truth]: leds_m: {len(truth.leds_m)} errors for {leds} LEDs")


def true_robots(config: Config, truth: Truth) -> Config:
    """The robots as they are; the configuration itself where nothing differs.

    Args:
        config: as the robots have it.
        truth: its errors.
    """
    errors = truth.drawn(len(config.leds.positions_m))
    exact = Truth(seed=errors.seed, tolerances=errors.tolerances, latency_ms=errors.latency_ms)
    if errors == exact:
        return config
    can, base = config.follower_can, config.base
    # a wheel of another radius turns as far for its counts, and moves the robot farther: as another gear would
    left, right = (1.0 + error for error in errors.wheel_radius)
    gears = [
        (1.0 + gear) * (1.0 + encoder) / radius
        for gear, encoder, radius in zip(errors.gear, errors.encoder, (left, right), strict=True)
    ]
    camera = replaced(
        config.camera,
        mount_xyz_m=_sum(config.camera.mount_xyz_m, errors.camera_m),
        mount_tilt_deg=_sum(config.camera.mount_tilt_deg, errors.camera_tilt_deg),
        lens=_true_lens(config.camera.lens, errors),
    )
    wheels = replaced(
        can, left_wheel=_geared(can.left_wheel, gears[0]), right_wheel=_geared(can.right_wheel, gears[1])
    )
    return replaced(
        config,
        camera=camera,
        leds=replaced(config.leds, positions_m=_true_leds(config, errors)),
        base=replaced(base, track_m=base.track_m * (1.0 + errors.track)),
        follower_can=wheels,
    )


def _geared(drive: DriveConfig, factor: float) -> DriveConfig:
    """Encoder and gear alike scale what the drive's counts mean at the wheel."""
    return replaced(drive, gear_ratio=drive.gear_ratio * factor)


def _true_lens(lens: LensConfig, errors: Truth) -> LensConfig:
    """Focal length, centre and the coefficient of r²; a pinhole with distortion is one of the rational model."""
    du, dv = errors.centre_px
    changed: dict[str, object] = {
        "fx_px": lens.fx_px * (1.0 + errors.focal),
        "fy_px": lens.fy_px * (1.0 + errors.focal),
        "cx_px": lens.cx_px + du,
        "cy_px": lens.cy_px + dv,
    }
    if errors.distortion:
        coefficients = lens.coefficients if lens.model != "pinhole" else (0.0,) * 8
        model = lens.model if lens.model != "pinhole" else "rational"
        changed |= {"model": model, "coefficients": (coefficients[0] + errors.distortion, *coefficients[1:])}
    return replaced(lens, **changed)


def _true_leds(config: Config, errors: Truth) -> tuple[tuple[float, ...], ...]:
    """Each LED moved, then all with the tilted and lifted Leader."""
    points = config.leds.points + (np.array(errors.leds_m) if errors.leds_m else 0.0)
    pitch, roll = (math.radians(angle) for angle in errors.leader_tilt_deg)
    (cp, sp), (cr, sr) = (math.cos(pitch), math.sin(pitch)), (math.cos(roll), math.sin(roll))
    about_y = np.array([[cp, 0.0, -sp], [0.0, 1.0, 0.0], [sp, 0.0, cp]])
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    moved = points @ (about_y @ about_x).T + [0.0, 0.0, errors.leader_height_m]
    return tuple((float(x), float(y), float(z)) for x, y, z in moved)


def _sum(configured: tuple[float, ...], errors: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(a + b for a, b in zip(configured, errors, strict=True))
