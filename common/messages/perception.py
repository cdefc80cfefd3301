"""What the camera and the estimator publish."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field
from pydantic.dataclasses import dataclass

from common.messages.fields import STRICT, Angle, Count, Disturbance, Metres, Ns, Point2, StateCause, Text


@dataclass(frozen=True, config=STRICT)
class Frame:
    """Note of one 8-bit grey image. Its pixels stay in shared memory, see :mod:`common.frames.ring`."""

    SCHEMA: ClassVar[str] = "frame/1"
    sequence: Annotated[int, Field(ge=1, lt=2**63)]
    slot: Count  # of the frame ring
    capture_ns: Ns  # middle of the exposure
    camera_id: Text
    width_px: Annotated[int, Field(ge=1, le=8192)]
    height_px: Annotated[int, Field(ge=1, le=8192)]
    exposure_us: Annotated[float, Field(gt=0, le=1e6)]
    gain: Annotated[float, Field(gt=0, le=1000)]


@dataclass(frozen=True, config=STRICT)
class DockingState:
    """What the estimator found in one frame. The relative pose is that of {L} in {F}."""

    SCHEMA: ClassVar[str] = "docking_state/3"
    frame_sequence: Count
    capture_ns: Ns
    valid: bool  # the pose can be used; stays true while the estimator predicts through bad frames
    cause: StateCause  # what was wrong with this frame
    leds_seen: Annotated[int, Field(ge=0, le=64)]
    features: Annotated[tuple[Point2 | None, ...], Field(max_length=12)]  # measured [α, β] by LED; None: not seen
    features_filtered: Annotated[tuple[Point2, ...], Field(max_length=12)]  # [α, β] by LED, from the filtered pose
    theta_homography_rad: Angle | None  # θ_L^F of the paper's homography, where that has a solution
    x_m: Metres  # filtered relative pose at capture_ns
    y_m: Metres
    theta_rad: Angle
    covariance: Annotated[tuple[float, ...], Field(min_length=9, max_length=9)]  # of x [m], y [m], θ [rad], by row
    disturbance: tuple[
        Disturbance, Disturbance, Disturbance, Disturbance
    ]  # speed gain, turn gain, yaw [rad/s], sideways [m/s]
    fit: tuple[Metres, Metres, Angle, Angle, Angle] | None  # unfiltered: x, y [m], θ, camera pitch, roll [rad]
    fit_covariance: Annotated[tuple[float, ...], Field(min_length=9, max_length=9)] | None  # x, y, θ of fit; for logs
    residual_px: Annotated[float, Field(ge=0)]  # of the fit
    spots: Count  # found in the image
    frames_seen: Count  # since the process started
    frames_dropped: Count
    # hash of the lens, mounting and LEDs that the estimator goes by, taught images taken into account; empty: unknown
    geometry: Annotated[str, Field(max_length=16)] = ""
