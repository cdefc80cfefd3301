"""Frames and wheel twist in, docking state out: perception and observer together."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import astuple
from importlib import import_module

import numpy as np

from common.config import Config
from common.frames.ring import Image
from common.geometry import Array, Pose2, features_at
from common.messages import DockingState, Frame, StateCause
from common.timing import NS_PER_MS
from follower.estimator.detection import Detection
from follower.estimator.observer import RelativeObserver
from follower.estimator.pipeline import Perception
from follower.model.taught import geometry_tag

# an image that is not of now: what it shows is not carried on either
_DEAD: frozenset[StateCause] = frozenset({"frozen_camera", "not_following"})
# frames in a row that the observer may refuse before it restarts from what perception sees
_REFUSED_LIMIT = 6
_RESET_INFLATION = 4.0
_HOMOGRAPHY_SIGMA_RAD = math.radians(3.0)  # of one frame: the noise of θ that the paper simulates

ThetaRoute = Callable[[Array, Array, float], float | None]


class StateEstimator:
    """One call of :meth:`step` per frame, or without a frame when none came.

    Args:
        config: the robots.
        perception: another one than of images, for experiments; None: of images.
    """

    def __init__(self, config: Config, perception: Perception | None = None) -> None:
        self._config = config
        self._perception = perception or Perception(config)
        self._observer = RelativeObserver(config.leds.points, config.camera.mount, config.estimator)
        self._sigma = config.estimator.pixel_sigma_px / config.camera.lens.fx_px
        self._by_homography = config.estimator.method == "paper"
        self._homography = _homography_route(config)
        self._geometry = geometry_tag(config)
        self._coast_ns = round(config.estimator.coast_ms * NS_PER_MS)
        self._measured_ns: int | None = None
        self._refused = 0
        self._frame_sequence = 0
        self._seen = 0
        self._dropped = 0

    def forget_track(self) -> None:
        """No docking in progress: once lost, the array may be a different one. Does nothing while it is in sight."""
        if self._measured_ns is None:
            self._perception.forget_track()

    def step(
        self, frame: Frame, image: Image | None, twist: tuple[float, float], desired_features: Array | None
    ) -> DockingState:
        """Take one frame.

        Args:
            frame: its note; gaps in its sequence count as dropped frames.
            image: (h, w) pixels, None if they were overwritten before they could be read.
            twist: measured (v [m/s], ω [rad/s]) of {F}.
            desired_features: (n, 2) at the goal, for the paper's homography; None before there is a mission.
        """
        if self._frame_sequence and frame.sequence > self._frame_sequence:
            self._dropped += frame.sequence - self._frame_sequence - 1
        self._frame_sequence = frame.sequence
        self._seen += image is not None
        self._dropped += image is None
        camera = self._config.camera
        expected = self._expected(frame.capture_ns, twist)
        light = frame.exposure_us * frame.gain / (camera.exposure_us * camera.gain)
        detection = self._perception.process(image, frame.sequence, frame.capture_ns, twist, expected, light)
        theta_homography_rad = self._theta_by_homography(detection, desired_features, expected)
        self._filter(detection, twist, theta_homography_rad)
        return self._state(detection, frame.capture_ns, theta_homography_rad)

    def no_frame(self, now_ns: int, twist: tuple[float, float], cause: StateCause = "no_frame") -> DockingState:
        """The state when no frame came, or a stale one: the last pose, not valid.

        The search continues at the pose predicted from the wheels.
        """
        self._perception.drive(now_ns, twist)
        nothing = np.full((len(self._config.leds.points), 2), np.nan)
        self._measured_ns = None
        return self._state(Detection(self._frame_sequence, now_ns, False, cause, nothing, nothing), now_ns)

    def _expected(self, capture_ns: int, twist: tuple[float, float]) -> Pose2 | None:
        return self._observer.pose_at(capture_ns, *twist) if self._measured_ns is not None else None

    def _theta_by_homography(
        self, detection: Detection, desired_features: Array | None, expected: Pose2 | None
    ) -> float | None:
        """θ_L^F [rad] of the paper's homography; None where no method reads it or it has no solution."""
        if self._homography is None or desired_features is None or not detection.valid or detection.pose is None:
            return None
        return self._homography(detection.features, desired_features, (expected or detection.pose).theta_rad)

    def _filter(self, detection: Detection, twist: tuple[float, float], theta_homography_rad: float | None) -> None:
        capture_ns = detection.capture_ns
        if self._measured_ns is not None:
            if capture_ns - self._measured_ns > self._coast_ns or capture_ns < self._measured_ns:
                self._measured_ns = None
            else:
                self._observer.predict(capture_ns, *twist)
        if detection.cause in _DEAD:
            self._measured_ns = None
        if not detection.valid or detection.pose is None or detection.covariance is None:
            return
        heading = None
        if self._by_homography and theta_homography_rad is not None:
            heading = theta_homography_rad, _HOMOGRAPHY_SIGMA_RAD
        if self._measured_ns is not None:
            used = self._observer.update(detection.features_level, self._sigma, heading)
            self._refused = 0 if used.sum() >= len(used) - 1 else self._refused + 1
        if self._measured_ns is None or self._refused >= _REFUSED_LIMIT:
            pose, covariance = detection.pose, _RESET_INFLATION * detection.covariance
            if heading is not None:
                pose, covariance = _turned(pose, covariance, heading)
            self._observer.reset(pose, covariance, capture_ns)
            self._refused = 0
        self._measured_ns = capture_ns

    def _state(
        self, detection: Detection, capture_ns: int, theta_homography_rad: float | None = None
    ) -> DockingState:
        valid = self._measured_ns is not None
        cause = detection.cause  # the frame's own, also while the pose is carried on without it
        pose = self._observer.pose
        filtered: tuple[tuple[float, float], ...] = ()
        if valid:
            try:
                features = features_at(self._config.leds.points, pose, self._config.camera.mount)
                filtered = tuple((float(a), float(b)) for a, b in features)
            except ValueError:
                valid, cause = False, "behind_camera"
        return DockingState(
            frame_sequence=detection.frame_sequence,
            capture_ns=capture_ns,
            valid=valid,
            cause=cause,
            leds_seen=detection.leds_seen,
            features=tuple(None if np.isnan(a) else (float(a), float(b)) for a, b in detection.features),
            features_filtered=filtered,
            theta_homography_rad=theta_homography_rad,
            x_m=pose.x_m,
            y_m=pose.y_m,
            theta_rad=pose.theta_rad,
            covariance=_row(self._observer.covariance),
            disturbance=astuple(self._observer.disturbance),
            fit=_fit(detection),
            fit_covariance=None if detection.covariance is None else _row(detection.covariance),
            residual_px=detection.residual_px,
            spots=detection.spots,
            frames_seen=self._seen,
            frames_dropped=self._dropped,
            geometry=self._geometry,
        )


def _fit(detection: Detection) -> tuple[float, float, float, float, float] | None:
    pose = detection.pose
    if pose is None:
        return None
    return pose.x_m, pose.y_m, pose.theta_rad, detection.pitch_rad, detection.roll_rad


def _turned(pose: Pose2, covariance: Array, heading: tuple[float, float]) -> tuple[Pose2, Array]:
    """The pose and its (3, 3) covariance with θ and its standard deviation taken from elsewhere."""
    theta_rad, sigma_rad = heading
    independent = covariance.copy()
    independent[2, :] = independent[:, 2] = 0.0
    independent[2, 2] = sigma_rad**2
    return Pose2(pose.x_m, pose.y_m, theta_rad), independent


def _row(matrix: Array) -> tuple[float, ...]:
    """A (3, 3) matrix row by row."""
    return tuple(float(value) for value in matrix.reshape(-1))


def _homography_route(config: Config) -> ThetaRoute | None:
    """The paper's θ where one of the paper's methods reads it; its module is imported only then."""
    if config.estimator.method != "paper" and not config.controller.method.startswith("paper"):
        return None
    route: ThetaRoute = import_module("follower.paper.homography").route(config.leds.points)
    return route
