"""Camera, LEDs and estimator."""

from __future__ import annotations

from functools import cached_property
from itertools import combinations
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from common.config.section import NonNegative, Positive, Section, Xyz
from common.geometry import Array, Pinhole, mirror_deviation_m
from common.led_code import CODES

_Pixel = Annotated[float, Field(ge=-1e5, le=1e5)]
_Coefficient = Annotated[float, Field(ge=-1e4, le=1e4)]


class LensConfig(Section):
    """Intrinsics. ``coefficients`` in OpenCV's order: none for pinhole, 8 for rational, 4 for fisheye."""

    model: Literal["pinhole", "rational", "fisheye"] = "pinhole"
    fx_px: Positive
    fy_px: Positive
    cx_px: _Pixel
    cy_px: _Pixel
    coefficients: tuple[_Coefficient, ...] = ()

    @model_validator(mode="after")
    def _coefficients_fit_model(self) -> LensConfig:
        wanted = {"pinhole": 0, "rational": 8, "fisheye": 4}[self.model]
        if len(self.coefficients) != wanted:
            raise ValueError(f"lens model {self.model!r} takes {wanted} coefficients, not {len(self.coefficients)}")
        return self


class CameraConfig(Section):
    """The Follower's camera: driver, image format, exposure and mounting.

    ``device`` is the serial number (mindvision), ``/dev/video0`` (v4l2), a folder or video (replay); empty: the only
    one connected. ``mount_xyz_m`` is ξ, ``mount_tilt_deg`` pitch (up), roll (right side down) and yaw (to the left)
    of the mounting. ``calibration`` is the file of ``davpc calibrate camera`` that ``lens`` was taken from, beside
    the configuration; ``davpc doctor`` compares it with ``lens`` and with the camera, and checks its age.
    """

    driver: str
    device: str = ""
    rate_hz: Annotated[float, Field(gt=0, le=500)]
    width_px: Annotated[int, Field(ge=64, le=8192)]
    height_px: Annotated[int, Field(ge=64, le=8192)]
    exposure_us: Annotated[float, Field(gt=0, le=100_000)]
    gain: Annotated[float, Field(gt=0, le=64)]
    mount_xyz_m: Xyz
    mount_tilt_deg: Xyz = (0.0, 0.0, 0.0)
    calibration: str = ""
    calibration_max_days: Annotated[int, Field(ge=1, le=3650, description="older ones arm nothing")] = 365
    lens: LensConfig

    @cached_property
    def pinhole(self) -> Pinhole:
        """The lens without its distortion."""
        lens = self.lens
        return Pinhole(lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px, self.width_px, self.height_px)

    @cached_property
    def mount(self) -> Array:
        """ξ, the optical centre in {F} [m]."""
        return np.array(self.mount_xyz_m)

    @cached_property
    def mount_tilt(self) -> Array:
        """Pitch, roll, yaw of the mounting [rad]."""
        return np.radians(self.mount_tilt_deg)


class BrightnessConfig(Section):
    """Expected brightness of an LED in the image; a spot that differs by more than ``factor`` is rejected."""

    grey_per_us_at_1_m: Annotated[
        float, Field(gt=0, description="peak on the axis at 1 A and gain 1, before clipping")
    ]
    speck_px: Annotated[
        float, Field(gt=0, le=20, description="distance along a row over which its image falls to 1/e")
    ]
    factor: Annotated[
        float, Field(ge=2, le=1e9, description="largest ratio to the expected brightness, and its inverse")
    ]


class LedCodeConfig(Section):
    """The light code of this pair, see docs/led-code.md; every pair of a site has another ``number``."""

    number: Annotated[int, Field(ge=0, lt=CODES, description="of the code; every pair of a site has another one")]
    symbol_ms: Annotated[
        int, Field(ge=40, le=200, multiple_of=20, description="duration of a symbol, in steps of the Leader")
    ] = 60
    depth: Annotated[float, Field(ge=0.1, le=0.8, description="reduction of the current in a dim symbol")] = 0.4


class LedsConfig(Section):
    """The Leader's array: LED positions in {L}, beam and nominal current.

    Without ``brightness`` the absolute brightness of spots is not checked. Without ``code`` the LEDs shine steadily,
    and any array of this shape is taken for the Leader.
    """

    positions_m: Annotated[tuple[Xyz, ...], Field(min_length=4, max_length=12)]
    full_beam_deg: Annotated[float, Field(gt=0, le=180)]
    current_a: Annotated[float, Field(gt=0, le=5)]
    brightness: BrightnessConfig | None = None
    code: LedCodeConfig | None = None

    @cached_property
    def points(self) -> Array:
        """LED positions (n, 3) in {L} [m]."""
        return np.array(self.positions_m)

    @model_validator(mode="after")
    def _coplanar(self) -> LedsConfig:
        centred = self.points - self.points.mean(axis=0)
        singular = np.linalg.svd(centred, compute_uv=False)
        if singular[1] < 0.05:
            raise ValueError("the LEDs are collinear: they do not determine the relative pose")
        for a, b in combinations(range(len(self.points)), 2):
            if np.linalg.norm(self.points[a] - self.points[b]) < 0.04:
                raise ValueError(f"the LEDs {a} and {b} lie within 4 cm: from a distance they merge into one spot")
        if len(self.points) == 4:
            for three in combinations(range(4), 3):
                _check_triangle(self.points[list(three)], three)
        if singular[2] > 0.02:
            raise ValueError("the LEDs are not coplanar: the homography of the paper does not exist")
        if mirror_deviation_m(self.points) < 0.05:
            raise ValueError(
                "the LEDs are symmetric: their mirror image in a pane of glass looks like the array itself"
            )
        return self


def _check_triangle(corners: Array, rows: tuple[int, ...]) -> None:
    """Any three of four LEDs must determine the pose when the fourth is hidden.

    Raises:
        ValueError: one lies within 4 cm of the line through the other two.
    """
    longest = max(float(np.linalg.norm(corners[i] - corners[j])) for i, j in ((0, 1), (1, 2), (2, 0)))
    if float(np.linalg.norm(np.cross(corners[1] - corners[0], corners[2] - corners[0]))) < 0.04 * longest:
        raise ValueError(f"the LEDs {', '.join(map(str, rows))} are collinear: alone they do not determine the pose")


Quadruple = tuple[NonNegative, NonNegative, NonNegative, NonNegative]


class DisturbanceConfig(Section):
    """Disturbance states of the observer, in the order: speed gain, turn gain, yaw [rad/s], sideways [m/s]."""

    walk: Annotated[Quadruple, Field(description="random walk while driving, per √s")]
    onset_sigma: Annotated[Quadruple, Field(description="σ of a disturbance once one is detected")]
    quiet_sigma: Annotated[Quadruple, Field(description="σ of a disturbance otherwise")]
    bound: Annotated[Quadruple, Field(description="bound of the estimate")]


class EstimatorConfig(Section):
    """Perception and the filtered relative state."""

    method: Literal["paper", "davpc"]
    threshold: Annotated[int, Field(ge=1, le=254)]
    min_spot_px: Annotated[int, Field(ge=1, le=2**26)]
    max_spot_px: Annotated[int, Field(ge=4, le=2**26)]
    gate_px: Positive
    identification_residual_px: Positive
    coast_ms: Positive
    pixel_sigma_px: Positive
    process_noise: Annotated[
        tuple[NonNegative, NonNegative, NonNegative], Field(description="x [m], y [m], θ [rad] per √s")
    ]
    distance_noise: Annotated[NonNegative, Field(description="x [m], y [m], θ [rad] per √m driven")]
    disturbance: DisturbanceConfig
