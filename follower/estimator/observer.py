"""Relative state from features and wheels, whatever disturbs the motion.

States are the pose of {L} in {F} and the four disturbances of :class:`follower.motion.MotionDisturbance`.
Several extended Kalman filters run beside each other (:mod:`follower.estimator.hypotheses`): one that expects no
disturbance averages the pose as far as the noise allows, others have one begin, change or end at some moment. Each
weighs as much as it explains of what is seen, and the estimate is their weighted mean. Nothing is decided, so that
nothing can be decided wrongly: a history that turns out better takes over.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from common.config import EstimatorConfig
from common.geometry import Array, Pose2
from common.timing import NS_PER_S
from follower.estimator.hypotheses import Branching
from follower.estimator.motion_model import DISTURBANCE, POSE, STATES, advance, advance_all
from follower.motion import MotionDisturbance, share_of_drift

Mask = NDArray[np.bool_]

GATE_CHI2 = 16.0  # squared Mahalanobis distance of one point, 2 degrees of freedom: 1 in 3000 good ones is refused
BRANCH_EVERY_S = 0.12
DRIVING = 0.2  # share of the full drift below which disturbances cannot be told
FADE_DOUBT = 0.7  # how far, of itself, a drift may be from the assumed fading when the speed has fallen to 1/e
DOUBTED_BELOW_M_S = 0.08  # nobody knows the law by which drifts fade on the way to standstill
STANDING_M_S = 1e-3


class RelativeObserver:
    """Filtered pose of {L} in {F}, and the disturbance. ``reset`` before anything else."""

    def __init__(self, points_l: Array, camera_xyz_m: Array, config: EstimatorConfig) -> None:
        self._points_l = points_l
        self._camera = camera_xyz_m
        self._config = config
        self._branching = Branching(config.disturbance)
        self._walk = np.square(config.disturbance.walk)
        self._bound = np.array(config.disturbance.bound)
        self._known = self._branching.begin(np.zeros(3), np.eye(3))
        self._mean: Array | None = None
        self._by_disturbance = np.zeros((3, 4))
        self._time_ns = self._branched_ns = 0
        self._drifting = 0.0
        self._least_m_s = STANDING_M_S

    def reset(self, pose: Pose2, covariance: Array, time_ns: int) -> None:
        """Begin anew from a pose, its (3, 3) covariance [m, m, rad] and the time they belong to."""
        self._known = self._branching.begin(pose.as_array(), covariance)
        self._mean = None
        self._time_ns = self._branched_ns = time_ns

    @property
    def pose(self) -> Pose2:
        """Estimated pose of {L} in {F} at the time of the last predict or reset."""
        return _pose(self._state)

    @property
    def covariance(self) -> Array:
        """(3, 3), of x [m], y [m], θ [rad]."""
        return self._known.pose_covariance()

    @property
    def disturbance(self) -> MotionDisturbance:
        """Estimated disturbance, bounded."""
        return MotionDisturbance(*(float(value) for value in self._state[DISTURBANCE]))

    def pose_at(self, time_ns: int, v_m_s: float, w_rad_s: float) -> Pose2:
        """The pose at another time, nearby, if the wheels turn with this twist until then."""
        return _pose(advance(self._state, v_m_s, w_rad_s, (time_ns - self._time_ns) / NS_PER_S)[0])

    @property
    def _state(self) -> Array:
        """Expected state (7,)."""
        if self._mean is None:
            self._mean = self._known.mean()
        return self._mean

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
        known = self._known
        known.states, transition = advance_all(known.states, v_m_s, w_rad_s, duration_s)
        covariances = transition @ known.covariances @ transition.swapaxes(1, 2)
        self._drifting = share_of_drift(v_m_s)
        noise = np.empty((len(known.states), STATES))
        noise[:, POSE] = np.square(self._config.process_noise) + self._config.distance_noise**2 * abs(v_m_s)
        noise[:, POSE] *= duration_s
        noise[:, DISTURBANCE] = known.kinds * (self._walk * (self._drifting * duration_s))
        noise[:, 5:] += self._doubt(v_m_s) * known.kinds[:, 2:] * np.square(known.states[:, 5:])
        covariances.reshape(len(noise), -1)[:, :: STATES + 1] += noise
        known.covariances = covariances
        self._by_disturbance = transition[known.likeliest, POSE, DISTURBANCE] / duration_s
        self._time_ns = time_ns
        self._mean = None

    def update(self, features: Array, sigma_normalised: float, heading: tuple[float, float] | None = None) -> Mask:
        """Correct with the features of the image taken at the time of the last predict.

        Args:
            features: (n, 2) normalised coordinates, NaN for what was not seen.
            sigma_normalised: standard deviation of one coordinate.
            heading: a measurement of θ_L^F and its standard deviation [rad]; θ is then taken from it, and the
                features, which it may have come from, correct the place alone. None: θ from the features too.

        Returns:
            (n,) whether each point was used by the likeliest history; not those unseen or outside its gate.
        """
        ahead = _array_ahead(self._known.states, self._points_l, self._camera)
        if not ahead.any():
            return np.zeros(len(features), dtype=bool)
        if not ahead.all():
            self._known = self._known.take(np.flatnonzero(ahead))
        known = self._known
        seen, slopes = _look(known.states, self._points_l, self._camera)
        visible = np.isfinite(features[:, 0]) & np.isfinite(features[:, 1])
        residual = np.where(np.tile(visible, 2), features.T.reshape(-1) - seen, 0.0) / sigma_normalised
        slopes /= sigma_normalised
        used, refused_chi2 = _gate(residual, slopes, known.covariances[:, POSE, POSE], visible)
        if not used.all():
            rows = np.concatenate([used, used], axis=1)
            residual, slopes = residual * rows, slopes * rows[:, :, None]
        if heading is not None:
            slopes[:, :, 2] = 0.0  # θ comes from there alone
        information = slopes.swapaxes(1, 2) @ slopes
        vector = (residual[:, None] @ slopes)[:, 0]
        chi2 = (residual * residual).sum(axis=1) + refused_chi2
        if heading is not None:
            apart = np.remainder(heading[0] - known.states[:, 2] + math.pi, 2 * math.pi) - math.pi
            information[:, 2, 2] += 1.0 / heading[1] ** 2
            vector[:, 2] += apart / heading[1] ** 2
            chi2 += np.square(apart / heading[1])
        self._correct(information, vector, chi2)
        likeliest = known.likeliest
        self._branch()
        self._mean = None
        return np.asarray(used[likeliest])

    def _correct(self, information: Array, vector: Array, chi2: Array) -> None:
        """Kalman update in information form: (k, 3, 3) JᵀJ and (k, 3) Jᵀr of whitened rows, (k,) rᵀr."""
        known = self._known
        columns = known.covariances[:, :, POSE]
        mixed = np.eye(3) + information @ columns[:, POSE]
        right = np.concatenate([vector[:, :, None], information @ columns.swapaxes(1, 2)], axis=2)
        solved = np.linalg.solve(mixed, right)
        change = columns @ solved
        known.states = known.states + change[:, :, 0]
        known.states[:, DISTURBANCE] = np.clip(known.states[:, DISTURBANCE], -self._bound, self._bound)
        covariances = known.covariances - change[:, :, 1:]
        known.covariances = 0.5 * (covariances + covariances.swapaxes(1, 2))
        explained = (vector * change[:, POSE, 0]).sum(axis=1)
        known.log_weights = known.log_weights - 0.5 * (chi2 - explained + np.log(np.linalg.det(mixed)))
        known.log_weights -= known.log_weights.max()

    def _branch(self) -> None:
        since_s = (self._time_ns - self._branched_ns) / NS_PER_S
        if since_s < BRANCH_EVERY_S:
            return
        self._branched_ns = self._time_ns
        if self._drifting > DRIVING:
            self._known = self._branching.branch(self._known, self._by_disturbance, since_s)
        else:
            self._known = self._branching.prune(self._known)

    def _doubt(self, v_m_s: float) -> float:
        """Variance, relative to a drift's square, that a drop of the speed to the least of late brings."""
        speed = max(abs(v_m_s), STANDING_M_S)
        if speed >= DOUBTED_BELOW_M_S:
            self._least_m_s = DOUBTED_BELOW_M_S
        slower = max(0.0, math.log(self._least_m_s / speed))
        self._least_m_s = min(self._least_m_s, speed)
        return FADE_DOUBT**2 * slower


def _array_ahead(states: Array, points_l: Array, camera_xyz_m: Array) -> Mask:
    """(k,) whether every LED lies before the camera."""
    cos, sin = np.cos(states[:, 2:3]), np.sin(states[:, 2:3])
    depth = states[:, 0:1] - camera_xyz_m[0] + cos * points_l[:, 0] - sin * points_l[:, 1]
    ahead: Mask = depth.min(axis=1) > 0.0
    return ahead


def _look(states: Array, points_l: Array, camera_xyz_m: Array) -> tuple[Array, Array]:
    """Features from k states, (k, 2n), all α before all β, and their slopes by the pose, (k, 2n, 3)."""
    cos, sin = np.cos(states[:, 2:3]), np.sin(states[:, 2:3])
    x, y = points_l[:, 0], points_l[:, 1]
    along, left = cos * x - sin * y, sin * x + cos * y
    depth = states[:, 0:1] + (along - camera_xyz_m[0])
    inverse, count = 1.0 / depth, len(x)
    seen = np.empty((len(states), 2 * count))
    seen[:, :count] = (camera_xyz_m[1] - states[:, 1:2] - left) * inverse
    seen[:, count:] = (camera_xyz_m[2] - points_l[:, 2]) * inverse
    slopes = np.empty((len(states), 2 * count, 3))
    twice = np.concatenate([inverse, inverse], axis=1)
    by_depth = -seen * twice
    slopes[:, :, 0] = by_depth
    slopes[:, :count, 1], slopes[:, count:, 1] = -inverse, 0.0
    slopes[:, :, 2] = -by_depth * np.concatenate([left, left], axis=1)
    slopes[:, :count, 2] -= along * inverse
    return seen, slopes


def _gate(residual: Array, slopes: Array, covariances: Array, visible: Mask) -> tuple[Mask, Array]:
    """(k, n) which points each history explains, and (k,) what those that it does not are charged."""
    count = len(visible)
    by_pose = slopes @ covariances
    variance = 1.0 + (by_pose * slopes).sum(axis=2)
    a, d = variance[:, :count], variance[:, count:]
    b = (by_pose[:, :count] * slopes[:, count:]).sum(axis=2)
    alpha, beta = residual[:, :count], residual[:, count:]
    chi2 = (d * alpha * alpha - 2 * b * alpha * beta + a * beta * beta) / (a * d - b * b)
    used = (chi2 <= GATE_CHI2) & visible
    return used, GATE_CHI2 * (visible & ~used).sum(axis=1)


def _pose(state: Array) -> Pose2:
    return Pose2(float(state[0]), float(state[1]), float(state[2]))
