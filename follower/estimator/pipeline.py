"""Frame → Detection: spots, identification or tracking, the fitted pose, and why a frame is of no use.

A new lock is used only after it has held for some frames. When the array is lost, the state is carried on by
the measured twist for a while and the array looked for around it; after that, in the whole image, but only where
the wheels can have brought it since. What is carried on is never reported as seen: every frame without the array is
invalid, with its cause.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from common.config import Config
from common.frames.ring import Image
from common.geometry import Array, Pose2
from common.messages import StateCause
from common.timing import NS_PER_MS, NS_PER_S
from follower.estimator.detection import Detection
from follower.estimator.identity.code_receiver import CodeReceiver
from follower.estimator.identity.finder import MOST_CANDIDATES, ArrayFinder
from follower.estimator.identity.sorting import Sorting
from follower.estimator.image_health import ImageFollows, ImageHealth, ImageReport
from follower.estimator.lens import Lens
from follower.estimator.planar_fit import FitModel
from follower.estimator.single_fit import levelled
from follower.estimator.spots import NoisyImageError, SpotRule, find_spots_near
from follower.estimator.tracking import ArrayTracker, Followed, nearest_within, predict_features, predict_state
from follower.model.dead_reckoning import DeadReckoning

TILT_SIGMA_RAD = math.radians(0.7)
_REGION_HALF_PX = 20
_CONFIRM_FULL, _CONFIRM_PARTIAL = 4, 20
_FEW_CANDIDATES = 10
_MOVING = 0.02  # m/s or rad/s
_KEEP_NS = 1_250 * NS_PER_MS


@dataclass(frozen=True)
class _Track:
    """The array as last known: state and features at ``capture_ns``, spot masses, how long seen and unseen."""

    capture_ns: int
    state: Array
    features: Array
    mass: Array
    to_confirm: int
    unseen_frames: int = 0
    unseen_ns: int = 0


class Perception:
    """Keeps the track between frames; one call of :meth:`process` per frame, in order."""

    def __init__(self, config: Config) -> None:
        estimator, camera = config.estimator, config.camera
        self._settings = estimator
        self._lens = Lens(camera)
        self._focal_px = camera.lens.fx_px
        self._points = config.leds.points
        self._mount = camera.mount
        self._height = self._mount[2] - self._points[:, 2]
        sigma = estimator.pixel_sigma_px / self._focal_px
        self._model = FitModel(self._points, self._mount, sigma, TILT_SIGMA_RAD)
        self._finder = ArrayFinder(config, self._model, self._lens)
        self._tracker = ArrayTracker(self._model, self._lens, estimator.gate_px)
        self._health = ImageHealth((camera.height_px, camera.width_px))
        self._follows = ImageFollows(self._height, self._mount, sigma)
        self._reckoning = DeadReckoning(estimator)
        code = config.leds.code if estimator.method == "davpc" else None
        self._sorting = None if code is None else Sorting(code, camera.rate_hz, self._tracker)
        self._receiver: CodeReceiver | None = None
        self._track: _Track | None = None
        self._light = 1.0

    def forget_track(self) -> None:
        """No docking in progress: the next array may be a different one, anywhere."""
        self._reckoning.forget()

    def process(
        self,
        image: Image | None,
        frame_sequence: int,
        capture_ns: int,
        twist: tuple[float, float],
        predicted: Pose2 | None = None,
        light: float = 1.0,
    ) -> Detection:
        """Take one frame.

        Args:
            image: (h, w) uint8, or None if its pixels could not be had.
            frame_sequence: the camera's count.
            capture_ns: middle of the exposure.
            twist: measured (v [m/s], ω [rad/s]) of {F} around the capture.
            predicted: pose of {L} in {F} at the capture as the observer expects it; where the array was not seen
                in the last frame, it is looked for there.
            light: the frame's exposure times gain over the configured ones.
        """
        self._light = light
        nowhere = np.full((len(self._points), 2), np.nan)
        nothing = Detection(frame_sequence, capture_ns, False, "no_frame", nowhere, nowhere)
        seen = self._health.look(image, capture_ns)
        if seen.cause != "stale_frame":
            self._reckoning.drive(capture_ns, twist)
        if image is None or seen.cause is not None:
            return replace(nothing, cause=seen.cause or "no_frame")
        rule = self._rule(seen.background)
        track = self._track
        try:
            detection = self._followed(image, rule, nothing, twist, predicted)
            if detection is None:
                detection = self._searched(image, rule, nothing, twist)
        except NoisyImageError:
            self._track = track
            return replace(nothing, cause=seen.exposure or "noisy")
        if detection.pose is None:
            detection = replace(detection, cause=self._exposure(image, rule, seen, detection))
        if self._health.frozen(detection.features, moving=abs(twist[0]) > _MOVING or abs(twist[1]) > _MOVING):
            return replace(detection, valid=False, cause="frozen_camera")
        if self._follows.doubted(detection.features, twist, capture_ns):
            return replace(detection, valid=False, cause="not_following")
        if not detection.valid or detection.pose is None or detection.covariance is None:
            return detection
        self._reckoning.seen(detection.pose, detection.covariance, capture_ns)
        return detection

    def drive(self, now_ns: int, twist: tuple[float, float]) -> None:
        """No frame came: drive on without sight, with the (v [m/s], ω [rad/s]) measured until now."""
        self._reckoning.drive(now_ns, twist)

    def _exposure(self, image: Image, rule: SpotRule, seen: ImageReport, detection: Detection) -> StateCause:
        """Why nothing was found: the exposure, if it is that; the array may show only at a lower threshold."""
        if seen.exposure is not None:
            return seen.exposure
        dim = round(seen.background + self._settings.threshold / 10)
        if detection.cause != "few_leds" or dim >= rule.threshold:
            return detection.cause
        shows = self._finder.shows(image, replace(rule, threshold=dim))
        return "underexposed" if shows else detection.cause

    def _rule(self, background: float) -> SpotRule:
        """λ_I as configured for the paper's method, else half of it above the background."""
        settings = self._settings
        paper = settings.method == "paper"
        level = settings.threshold if paper else round(background + settings.threshold / 2)
        return SpotRule(
            min(level, 254),
            settings.min_spot_px,
            settings.max_spot_px,
            "paper" if paper else "above_threshold",
        )

    def _followed(
        self,
        image: Image,
        rule: SpotRule,
        nothing: Detection,
        twist: tuple[float, float],
        predicted: Pose2 | None,
    ) -> Detection | None:
        """The array where prediction has it, or that it is not there; None without a track."""
        track, self._track = self._track, None
        if track is None:
            return None
        elapsed_ns = nothing.capture_ns - track.capture_ns
        if elapsed_ns > _KEEP_NS:
            return None
        state = predict_state(track.state, twist, elapsed_ns / NS_PER_S)
        if predicted is not None and track.unseen_frames > 0:  # just seen, the last fit is better, tilt included
            state[:3] = predicted.as_array()
        if self._settings.method == "paper":
            found = self._nearest(image, rule, track, twist, elapsed_ns / NS_PER_S)
        else:
            found = self._tracker.follow(image, rule, state, track.mass, track.unseen_frames)
        if isinstance(found, Followed):
            if self._receiver is not None and self._receiver.take(nothing.capture_ns, found.seen_mass) == "other":
                self._reckoning.forget()  # it was not ours: what it showed says nothing about where ours is
                return replace(self._report(nothing, found, confirmed=False), cause="wrong_array")
            self._track = _Track(
                nothing.capture_ns, found.fitted.state, found.features, found.mass, max(track.to_confirm - 1, 0)
            )
            return self._report(nothing, found, confirmed=track.to_confirm <= 1)
        return self._coasted(image, rule, nothing, track, state, twist, found)

    def _coasted(
        self,
        image: Image,
        rule: SpotRule,
        nothing: Detection,
        track: _Track,
        state: Array,
        twist: tuple[float, float],
        spots: int,
    ) -> Detection | None:
        """Predict the track without a measurement; None when a full search should start."""
        unseen_ns = track.unseen_ns + nothing.capture_ns - track.capture_ns
        if track.to_confirm > 0 or unseen_ns > _KEEP_NS or self._settings.method == "paper":
            return None
        cause: StateCause = "coasting"
        if unseen_ns > self._settings.coast_ms * NS_PER_MS:
            found_again = self._searched(image, rule, nothing, twist)
            if self._track is not None:
                return found_again
            cause = found_again.cause
        self._track = replace(
            track,
            capture_ns=nothing.capture_ns,
            state=state,
            unseen_frames=track.unseen_frames + 1,
            unseen_ns=unseen_ns,
        )
        return replace(nothing, cause=cause, spots=spots)

    def _nearest(
        self, image: Image, rule: SpotRule, track: _Track, twist: tuple[float, float], elapsed_s: float
    ) -> Followed | int:
        """As in the paper: each LED's nearest spot within the gate around its prediction, eq. (17)."""
        expected = predict_features(track.features, self._height, self._mount, twist, elapsed_s)
        expected_px = self._lens.to_pixels(expected)
        spots = find_spots_near(image, expected_px, _REGION_HALF_PX, rule)
        chosen = nearest_within(expected_px, spots.pixels, self._settings.gate_px)
        if min(chosen) < 0:
            return len(spots)
        return self._finder.taken(spots, chosen, track.state) or len(spots)

    def _searched(self, image: Image, rule: SpotRule, nothing: Detection, twist: tuple[float, float]) -> Detection:
        """Without a track: by the code, where there is one and the place of our array is not known."""
        if self._sorting is None:
            return self._identified(image, rule, nothing)
        if self._reckoning.known:
            self._sorting.restart()
            if self._receiver is not None:
                self._receiver.restart()
            return self._identified(image, rule, nothing)
        outcome = self._sorting.step(
            image, rule, nothing.capture_ns, twist, partial(self._finder.find_others, image, rule, self._light)
        )
        own = outcome.own
        if own is not None:
            self._track = _Track(own.capture_ns, own.state, own.found.features, own.found.mass, 0)
            self._receiver = own.receiver
            self._sorting.restart()
        nothing = replace(nothing, cause=outcome.cause, spots=outcome.spots)
        if outcome.best is None:
            return nothing
        return replace(self._report(nothing, outcome.best, confirmed=own is not None), cause=outcome.cause)

    def _identified(self, image: Image, rule: SpotRule, nothing: Detection) -> Detection:
        """The array wherever it is in the image; a lock that still has to be confirmed."""
        agrees = self._reckoning.agrees if self._reckoning.known else None
        found, spots = self._finder.find(image, rule, self._light, agrees)
        if not isinstance(found, Followed):
            return replace(nothing, cause=found, spots=spots)
        hidden = bool(np.isnan(found.features).any())
        to_confirm = _CONFIRM_PARTIAL if hidden else _CONFIRM_FULL
        if not self._reckoning.known:  # nothing but its looks speaks for it, and coincidence has more chances
            to_confirm += max(0, min(spots, MOST_CANDIDATES) - _FEW_CANDIDATES) // 2
        if self._settings.method == "paper":
            to_confirm = 0
        self._track = _Track(nothing.capture_ns, found.fitted.state, found.features, found.mass, to_confirm)
        return self._report(nothing, found, confirmed=to_confirm == 0)

    def _report(self, nothing: Detection, found: Followed, confirmed: bool) -> Detection:
        fitted = found.fitted
        return Detection(
            frame_sequence=nothing.frame_sequence,
            capture_ns=nothing.capture_ns,
            valid=confirmed,
            cause="ok" if confirmed else "confirming",
            features=found.features,
            features_level=levelled(found.features, fitted.pitch_rad, fitted.roll_rad),
            spots=found.spots,
            leds_seen=int(np.count_nonzero(np.isfinite(found.features[:, 0]))),
            pose=fitted.pose,
            pitch_rad=fitted.pitch_rad,
            roll_rad=fitted.roll_rad,
            covariance=fitted.covariance,
            residual_px=fitted.residual_rms * self._focal_px,
        )
