"""Frame → Detection: spots, identification or tracking, both routes to θ, and why a frame says nothing."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from common.config import Config
from common.frame_ring import Image
from common.geometry import Array, Pose2
from common.messages import StateCause
from common.timing import NS_PER_S
from follower.estimator.homography import array_normal, theta_from_homography
from follower.estimator.identification import Identifier, Limits
from follower.estimator.lens import Lens
from follower.estimator.planar_fit import FitModel, PlanarFit, fit_one, project
from follower.estimator.spots import SpotRule, Spots, brightest, find_spots, find_spots_near
from follower.estimator.tracking import nearest_within, predict_features

TILT_SIGMA_RAD = math.radians(0.7)
MOST_CANDIDATES = 40
_REGION_HALF_PX = 20


@dataclass(frozen=True)
class Detection:
    """What one frame says about the array.

    Attributes:
        frame_sequence, capture_ns: the frame.
        valid: whether features and pose may be used; else ``cause`` says why not.
        features: (n, 2) normalised [α, β] by LED, NaN where not seen.
        spots: candidates found, in the whole frame or in the tracked regions.
        leds_seen: LEDs that were matched.
        theta_homography_rad: θ_L^F of the paper's homography; None where it has no solution.
        pose: fitted pose of {L} in {F}; None without a fit, as are tilt, covariance and residual.
        pitch_rad, roll_rad: camera tilt away from its mounting: up, right side down.
        covariance: (3, 3) of x [m], y [m], θ [rad].
        residual_px: root mean square of the fit's reprojection errors.
    """

    frame_sequence: int
    capture_ns: int
    valid: bool
    cause: StateCause
    features: Array
    spots: int = 0
    leds_seen: int = 0
    theta_homography_rad: float | None = None
    pose: Pose2 | None = None
    pitch_rad: float = 0.0
    roll_rad: float = 0.0
    covariance: Array | None = None
    residual_px: float = 0.0


@dataclass(frozen=True)
class _Track:
    """The last frame in which the array was seen."""

    capture_ns: int
    features: Array
    state: Array


class Perception:
    """Keeps the track between frames; one call of :meth:`process` per frame, in order."""

    def __init__(self, config: Config) -> None:
        estimator = config.estimator
        self._config = config
        self._lens = Lens(config.camera)
        self._focal_px = config.camera.lens.fx_px
        self._points = config.leds.points
        self._mount = config.camera.mount
        self._height = self._mount[2] - self._points[:, 2]
        self._normal = array_normal(self._points)
        self._model = FitModel(self._points, self._mount, estimator.pixel_sigma_px / self._focal_px, TILT_SIGMA_RAD)
        self._identifier = Identifier(self._model, Limits())
        self._rule = SpotRule(
            estimator.threshold,
            estimator.min_spot_px,
            estimator.max_spot_px,
            "paper" if estimator.method == "paper" else "above_threshold",
        )
        self._track: _Track | None = None

    def process(
        self,
        image: Image | None,
        frame_sequence: int,
        capture_ns: int,
        twist: tuple[float, float],
        desired_features: Array | None,
        predicted: Pose2 | None = None,
    ) -> Detection:
        """Take one frame.

        Args:
            image: (h, w) uint8, or None if its pixels could not be had.
            frame_sequence: the camera's count.
            capture_ns: middle of the exposure.
            twist: measured (v [m/s], ω [rad/s]) of {F} around the capture.
            desired_features: (n, 2) normalised features at the goal; None: no homography.
            predicted: pose of {L} in {F} at the capture as the observer expects it.
        """
        nothing = Detection(frame_sequence, capture_ns, False, "no_frame", np.full((len(self._points), 2), np.nan))
        if image is None:
            return nothing
        camera = self._config.camera
        if image.shape != (camera.height_px, camera.width_px) or image.dtype != np.uint8:
            return replace(nothing, cause="bad_frame")
        detection = self._followed(image, nothing, twist, predicted) or self._identified(image, nothing)
        if not detection.valid or desired_features is None:
            return detection
        expected = predicted or detection.pose
        theta = theta_from_homography(
            detection.features, desired_features, self._normal, expected.theta_rad if expected else None
        )
        return replace(detection, theta_homography_rad=theta)

    def _followed(
        self, image: Image, nothing: Detection, twist: tuple[float, float], predicted: Pose2 | None
    ) -> Detection | None:
        """The array where prediction has it; None if it is not there, and the track is given up."""
        track, self._track = self._track, None
        if track is None:
            return None
        age_ns = nothing.capture_ns - track.capture_ns
        if not 0 < age_ns <= self._config.estimator.coast_ms * 1e6:
            return None
        if predicted is not None:
            ahead = np.array([*predicted.as_array(), *track.state[3:]])
            expected = project(self._model, ahead[None])[0][0]
        else:
            expected = predict_features(track.features, self._height, self._mount, twist, age_ns / NS_PER_S)
        expected_px = self._lens.to_pixels(expected)
        spots = find_spots_near(image, expected_px, _REGION_HALF_PX, self._rule)
        chosen = nearest_within(expected_px, spots.pixels, self._config.estimator.gate_px)
        if min(chosen) < 0:
            return None
        return self._measured(nothing, spots, self._lens.to_normalised(spots.pixels)[chosen], track.state)

    def _identified(self, image: Image, nothing: Detection) -> Detection:
        """The array wherever it is in the image."""
        spots = find_spots(image, self._rule)
        candidates = brightest(spots, MOST_CANDIDATES)
        features = self._lens.to_normalised(candidates.pixels)
        match = self._identifier.identify(features, candidates.mass, allow_partial=False)
        if match == "few_spots":
            return replace(nothing, cause="few_leds", spots=len(spots))
        if isinstance(match, str):
            return replace(nothing, cause="not_identified", spots=len(spots))
        found = self._measured(nothing, spots, features[list(match.spot_of_led)], match.state)
        return found if found is not None else replace(nothing, cause="residual", spots=len(spots))

    def _measured(self, nothing: Detection, spots: Spots, features: Array, start: Array) -> Detection | None:
        """The fitted detection; None if the features do not fit the array."""
        fitted = fit_one(self._model, features, start)
        if fitted is None:
            return None
        residual_px = float(np.sqrt(np.nanmean(fitted.residual**2))) * self._focal_px
        if residual_px > self._config.estimator.identification_residual_px:
            return None
        self._track = _Track(nothing.capture_ns, features, _state(fitted))
        return replace(
            nothing,
            valid=True,
            cause="ok",
            features=features,
            spots=len(spots),
            leds_seen=int(np.isfinite(features[:, 0]).sum()),
            pose=fitted.pose,
            pitch_rad=fitted.pitch_rad,
            roll_rad=fitted.roll_rad,
            covariance=fitted.covariance,
            residual_px=residual_px,
        )


def _state(fitted: PlanarFit) -> Array:
    return np.array([*fitted.pose.as_array(), fitted.pitch_rad, fitted.roll_rad])
