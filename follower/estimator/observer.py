"""Relative state from features and wheels: an extended Kalman filter that knows when it is being disturbed.

States are the pose of {L} in {F} and the four disturbances of :class:`follower.motion.MotionDisturbance`.
Most of the time there is no disturbance: then the four are held close to zero, and the pose is averaged as far as
the noise allows. When the innovation's mean shifts (:mod:`follower.estimator.onset`) the four are set free, as if
they had acted since shortly before; each is tied to zero again as soon as zero explains what is seen.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.config import EstimatorConfig
from common.geometry import Array, Pose2, feature_jacobian, features_at, points_in_camera, wrap_angle
from common.timing import NS_PER_S
from follower.estimator.motion_model import DISTURBANCE, POSE, STATES, advance
from follower.estimator.onset import Onset, OnsetDetector
from follower.motion import MotionDisturbance, share_of_drift

Mask = NDArray[np.bool_]

GATE_CHI2 = 16.0  # squared Mahalanobis distance of one point, 2 degrees of freedom: 1 in 3000 good ones is refused
QUIET_START_S = 0.3  # no onset is believed before the start's own uncertainty has settled
BETWEEN_ONSETS_S = 0.35
TIE_AFTER_S = 0.7
TIE_CHI2 = 2.3  # a disturbance this near to zero, squared in its own standard deviations, is taken for zero
SETTLED_SHARE = 1 / 9  # of the onset's variance, before zero may be concluded
CLEAR_SIGMAS = 5.0  # a disturbance beyond so many of its quiet standard deviations is one that can end
DRIVING = 0.2  # share of the full drift above which disturbances can be told


class RelativeObserver:
    """Filtered pose of {L} in {F}, and the disturbance. ``reset`` before anything else."""

    def __init__(self, points_l: Array, camera_xyz_m: Array, config: EstimatorConfig) -> None:
        self._points_l = points_l
        self._camera = camera_xyz_m
        self._config = config
        self._onset_variance = np.square(config.disturbance.onset_sigma)
        self._quiet_variance = np.square(config.disturbance.quiet_sigma)
        self._detector = OnsetDetector()
        self._state = np.zeros(STATES)
        self._covariance = np.eye(STATES)
        self._acting = np.zeros((STATES, 4))
        self._time_ns = self._reset_ns = self._onset_ns = 0
        self._drifting = 0.0

    def reset(self, pose: Pose2, covariance: Array, time_ns: int) -> None:
        """Begin anew from a pose, its (3, 3) covariance [m, m, rad] and the time they belong to; undisturbed."""
        self._state = np.concatenate([pose.as_array(), np.zeros(4)])
        self._covariance = np.zeros((STATES, STATES))
        self._covariance[POSE, POSE] = covariance
        self._covariance[DISTURBANCE, DISTURBANCE] = np.diag(self._quiet_variance)
        self._time_ns = self._reset_ns = self._onset_ns = time_ns
        self._detector.reset()

    @property
    def pose(self) -> Pose2:
        """Estimated pose of {L} in {F} at the time of the last predict or reset."""
        return _pose(self._state)

    @property
    def covariance(self) -> Array:
        """(3, 3), of x [m], y [m], θ [rad]."""
        return self._covariance[POSE, POSE].copy()

    @property
    def disturbance(self) -> MotionDisturbance:
        """Estimated disturbance, bounded."""
        return MotionDisturbance(*(float(value) for value in self._state[DISTURBANCE]))

    def pose_at(self, time_ns: int, v_m_s: float, w_rad_s: float) -> Pose2:
        """The pose at another time, nearby, if the wheels turn with this twist until then."""
        return _pose(advance(self._state, v_m_s, w_rad_s, (time_ns - self._time_ns) / NS_PER_S)[0])

    def predict(self, time_ns: int, v_m_s: float, w_rad_s: float) -> None:
        """Move on to ``time_ns`` with the wheel twist measured since the last call.

        Raises:
            ValueError: the time lies before the last call's.
        """
        duration_s = (time_ns - self._time_ns) / NS_PER_S
        if duration_s < 0:
            raise ValueError(f"the observer is at {self._time_ns} ns and cannot go back to {time_ns} ns")
        if duration_s == 0:
            return
        self._state, transition = advance(self._state, v_m_s, w_rad_s, duration_s)
        self._state[2] = wrap_angle(self._state[2])
        self._drifting = share_of_drift(v_m_s)
        noise = np.empty(STATES)
        still = np.square(self._config.process_noise)
        noise[POSE] = still + self._config.distance_noise**2 * abs(v_m_s)
        noise[DISTURBANCE] = np.square(self._config.disturbance.walk) * self._drifting
        self._covariance = transition @ self._covariance @ transition.T
        self._covariance.flat[:: STATES + 1] += noise * duration_s
        self._acting = transition[:, DISTURBANCE] / duration_s
        self._time_ns = time_ns

    def update(self, features: Array, sigma_normalised: float, heading: tuple[float, float] | None = None) -> Mask:
        """Correct with the features of the image taken at the time of the last predict.

        Args:
            features: (n, 2) normalised coordinates, NaN for what was not seen.
            sigma_normalised: standard deviation of one coordinate.
            heading: a measurement of θ_L^F and its standard deviation [rad]; θ is then taken from it, and the
                features, which it may have come from, correct the place alone. None: θ from the features too.

        Returns:
            (n,) whether each point was used; not those unseen or outside the gate.
        """
        if np.any(points_in_camera(self._points_l, self.pose, self._camera)[:, 2] <= 0):
            return np.zeros(len(features), dtype=bool)
        residual = (features - features_at(self._points_l, self.pose, self._camera)) / sigma_normalised
        jacobian = np.zeros((residual.size, STATES))
        jacobian[:, POSE] = feature_jacobian(self._points_l, self.pose, self._camera) / sigma_normalised
        seen: Mask = np.isfinite(residual[:, 0]) & np.isfinite(residual[:, 1])
        used = self._gate(residual, jacobian, seen)
        rows = np.repeat(used, 2)
        values, slopes = residual.reshape(-1)[rows], jacobian[rows]
        if heading is not None:
            slopes[:, 2] = 0.0
            values = np.append(values, wrap_angle(heading[0] - float(self._state[2])) / heading[1])
            slopes = np.vstack([slopes, np.eye(STATES)[2] / heading[1]])
        if values.size:
            self._correct(values, slopes)
            self._tie_to_zero()
        return used

    def _gate(self, residual: Array, jacobian: Array, seen: Mask) -> Mask:
        """Points to use; when most would be refused it is the motion that is wrong, not they."""
        spread = self._spread(jacobian)
        inside = _inside(residual, spread, seen)
        onset = None
        if self._may_begin():
            if 2 * inside.sum() < seen.sum():
                onset = Onset(acting_s=0.1, sideways=1.0, forward=1.0)
            elif inside.sum() >= 2:
                rows = np.repeat(inside, 2)
                onset = self._detector.update(residual[inside], spread[rows][:, rows])
        if onset is None:
            return inside
        if self._has_ended(onset, jacobian):
            self._set_to_zero(onset.acting_s)
        else:
            self._set_free(onset)
        self._onset_ns = self._time_ns
        return _inside(residual, self._spread(jacobian), seen)

    def _spread(self, jacobian: Array) -> Array:
        spread: Array = jacobian @ self._covariance @ jacobian.T
        spread.flat[:: len(spread) + 1] += 1.0
        return spread

    def _may_begin(self) -> bool:
        since_s = (self._time_ns - self._onset_ns) / NS_PER_S
        old_s = (self._time_ns - self._reset_ns) / NS_PER_S
        return self._drifting > DRIVING and since_s > BETWEEN_ONSETS_S and old_s > QUIET_START_S

    def _set_free(self, onset: Onset) -> None:
        """Widen the disturbances, as if they had been acting on the pose for a while already."""
        acted = self._acting * onset.acting_s
        acted[DISTURBANCE] = np.eye(4)
        forward, sideways = onset.forward != 0.0, onset.sideways != 0.0
        widened = self._onset_variance * [forward, sideways, sideways, sideways]
        self._covariance = self._covariance + (acted * widened) @ acted.T

    def _has_ended(self, onset: Onset, jacobian: Array) -> bool:
        """Whether the innovation goes to where it would if the disturbance known so far were gone."""
        value = self._state[DISTURBANCE]
        if np.all(np.abs(value) < CLEAR_SIGMAS * np.sqrt(self._quiet_variance)):
            return False
        without = -jacobian[0::2, POSE].mean(axis=0) @ self._acting[POSE] @ value
        return bool(without * onset.sideways > 0.0)

    def _set_to_zero(self, acting_s: float) -> None:
        """End the disturbance, and take back what it moved the pose since it really ended."""
        back = -acting_s * self._acting[POSE] @ self._state[DISTURBANCE]
        self._state[POSE] += back
        self._state[DISTURBANCE] = 0.0
        pose = self._covariance[POSE, POSE] + 0.25 * np.outer(back, back)
        self._covariance = np.zeros((STATES, STATES))
        self._covariance[POSE, POSE] = pose
        self._covariance[DISTURBANCE, DISTURBANCE] = np.diag(self._quiet_variance)

    def _tie_to_zero(self) -> None:
        """Conclude, of the disturbance nearest to zero, that it is none, once that can be told."""
        if self._drifting <= DRIVING or (self._time_ns - self._onset_ns) / NS_PER_S < TIE_AFTER_S:
            return
        value, variance = self._state[DISTURBANCE], np.diag(self._covariance)[DISTURBANCE]
        open_to_it = (variance > 4 * self._quiet_variance) & (variance < SETTLED_SHARE * self._onset_variance)
        distance = np.where(open_to_it, value**2 / variance, np.inf)
        nearest = int(np.argmin(distance))
        if distance[nearest] < TIE_CHI2:
            row = np.zeros(STATES)
            row[3 + nearest] = 1.0 / np.sqrt(self._quiet_variance[nearest])
            self._correct(np.array([-value[nearest] * row[3 + nearest]]), row[None])

    def _correct(self, residual: Array, jacobian: Array) -> None:
        """Kalman update with unit measurement noise; the covariance stays symmetric."""
        projected = jacobian @ self._covariance
        gain = np.linalg.solve(self._spread(jacobian), projected).T
        self._state = self._state + gain @ residual
        self._state[2] = wrap_angle(self._state[2])
        bound = self._config.disturbance.bound
        self._state[DISTURBANCE] = np.clip(self._state[DISTURBANCE], np.negative(bound), bound)
        covariance = self._covariance - gain @ projected
        self._covariance = 0.5 * (covariance + covariance.T)


def _inside(residual: Array, spread: Array, seen: Mask) -> Mask:
    """(n,) whether each point's 2×2 block explains its residual."""
    a, b, d = spread.diagonal()[0::2], spread.diagonal(1)[0::2], spread.diagonal()[1::2]
    alpha, beta = residual[:, 0], residual[:, 1]
    chi2 = (d * alpha**2 - 2 * b * alpha * beta + a * beta**2) / (a * d - b * b)
    inside: Mask = seen & (chi2 <= GATE_CHI2)
    return inside


def _pose(state: Array) -> Pose2:
    return Pose2(float(state[0]), float(state[1]), float(state[2]))
