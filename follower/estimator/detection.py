"""What perception finds in one frame."""

from __future__ import annotations

from dataclasses import dataclass

from common.geometry import Array, Pose2
from common.messages import StateCause


@dataclass(frozen=True)
class Detection:
    """What one frame shows of the array.

    Attributes:
        frame_sequence, capture_ns: the frame.
        valid: whether features and pose may be used; else ``cause`` is the reason.
        features: (n, 2) normalised [α, β] by LED as measured, NaN where not seen.
        features_level: (n, 2) the same as a camera without the fitted pitch and roll would see them.
        spots: candidates found, in the whole frame or in the tracked regions.
        leds_seen: LEDs that were matched.
        pose: fitted pose of {L} in {F}; None without a fit, as is the covariance.
        pitch_rad, roll_rad: camera tilt away from its mounting: up, right side down.
        covariance: (3, 3) of x [m], y [m], θ [rad].
        residual_px: root mean square of the fit's reprojection errors.
    """

    frame_sequence: int
    capture_ns: int
    valid: bool
    cause: StateCause
    features: Array
    features_level: Array
    spots: int = 0
    leds_seen: int = 0
    pose: Pose2 | None = None
    pitch_rad: float = 0.0
    roll_rad: float = 0.0
    covariance: Array | None = None
    residual_px: float = 0.0
