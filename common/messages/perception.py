"""What the camera and the estimator publish."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field
from pydantic.dataclasses import dataclass

from common.messages.fields import STRICT, Angle, Count, Metres, Ns, Point2, StateCause, Text


@dataclass(frozen=True, config=STRICT)
class Frame:
    """One 8-bit grey image: the note that says in which slot of the frame ring its pixels lie.

    ``capture_ns`` is the middle of the exposure. The pixels themselves never cross Zenoh (see
    :mod:`common.frame_ring`).
    """

    SCHEMA: ClassVar[str] = "frame/1"
    sequence: Annotated[int, Field(ge=1, lt=2**63)]
    slot: Count
    capture_ns: Ns
    camera_id: Text
    width_px: Annotated[int, Field(ge=1, le=8192)]
    height_px: Annotated[int, Field(ge=1, le=8192)]
    exposure_us: Annotated[float, Field(gt=0, le=1e6)]
    gain: Annotated[float, Field(gt=0, le=1000)]


@dataclass(frozen=True, config=STRICT)
class DockingState:
    """What the estimator knows of one frame.

    ``features`` are the measured normalised coordinates [α, β] of the LEDs, by LED, None for one not seen;
    ``features_filtered`` the same from the filtered pose. The pose is that of {L} in {F} at ``capture_ns``,
    its covariance row by row (x [m], y [m], θ [rad]). ``theta_homography_rad`` is θ_L^F of the paper's
    homography, None where it has no solution or no method of the paper is configured. ``disturbance`` is what the
    motion differs from the wheels by: relative speed, relative turn, yaw [rad/s], sideways [m/s]. ``fit`` is the
    frame's own planar fit, unfiltered: x [m], y [m], θ, camera pitch and roll [rad], with the covariance of x, y, θ
    in ``fit_covariance``. ``cause`` says
    what was wrong with the frame; ``valid`` outlives it for as long as the estimator carries the pose on.
    """

    SCHEMA: ClassVar[str] = "docking_state/1"
    frame_sequence: Count
    capture_ns: Ns
    valid: bool
    cause: StateCause
    leds_seen: Annotated[int, Field(ge=0, le=64)]
    features: Annotated[tuple[Point2 | None, ...], Field(max_length=12)]
    features_filtered: Annotated[tuple[Point2, ...], Field(max_length=12)]
    theta_homography_rad: Angle | None
    x_m: Metres
    y_m: Metres
    theta_rad: Angle
    covariance: Annotated[tuple[float, ...], Field(min_length=9, max_length=9)]
    disturbance: tuple[float, float, float, float]
    fit: tuple[Metres, Metres, Angle, Angle, Angle] | None
    fit_covariance: Annotated[tuple[float, ...], Field(min_length=9, max_length=9)] | None
    residual_px: Annotated[float, Field(ge=0)]
    spots: Count
    frames_seen: Count
    frames_dropped: Count
