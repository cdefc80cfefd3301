"""Relative state from features and wheels, whatever disturbs the motion.

States are the pose of {L} in {F} and the four disturbances of :class:`follower.model.motion.MotionDisturbance`.
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
from follower.estimator.hypotheses import Branching, Hypotheses
from follower.model.array import LedArray
from follower.model.motion import (
    DISTURBANCE,
    POSE,
    FadeDoubt,
    MotionDisturbance,
    advance,
    advance_all,
    share_of_drift,
)

Mask = NDArray[np.bool_]

GATE_CHI2 = 16.0  # squared Mahalanobis distance of one point, 2 degrees of freedom: 1 in 3000 good ones is refused
BRANCH_EVERY_S = 0.12
DRIVING = 0.2  # share of the full drift below which disturbances cannot be observed


class RelativeObserver:
    """Filtered pose of {L} in {F}, and the disturbance. ``reset`` before anything else."""

    def __init__(self, points_l: Array, camera_xyz_m: Array, config: EstimatorConfig) -> None:
        self._array = LedArray(points_l, camera_xyz_m)
        self._config = config
        self._branching = Branching(config.disturbance)
        self._walk = np.square(config.disturbance.walk)
        self._bound = np.array(config.disturbance.bound)
        self._process = np.square(config.process_noise)
        self._known = self._branching.begin(np.zeros(3), np.eye(3))
        self._mean: Array | None = None
        self._by_disturbance = np.zeros((3, 4))
        self._time_ns = self._branched_ns = 0
        self._drifting = 0.0
        self._fade = FadeDoubt()

    def reset(self, pose: Pose2, covariance: Array, time_ns: int) -> None:
        """Start again.

        Args:
            pose: of {L} in {F}.
            covariance: (3, 3) of x [m], y [m], θ [rad].
            time_ns: the time they belong to.
        """
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
        known.states, slopes = advance_all(known.states, v_m_s, w_rad_s, duration_s)
        known.covariances = self._carried(known, slopes, v_m_s, duration_s)
        self._by_disturbance = slopes[known.likeliest, :, DISTURBANCE] / duration_s
        self._time_ns = time_ns
        self._mean = None

    def _carried(self, known: Hypotheses, slopes: Array, v_m_s: float, duration_s: float) -> Array:
        """(k, 7, 7): the covariances moved on by (k, 3, 7) slopes of the pose, process noise added."""
        self._drifting = share_of_drift(v_m_s)
        covariances = known.covariances
        by_slopes = slopes @ covariances
        covariances[:, POSE, DISTURBANCE] = by_slopes[:, :, DISTURBANCE]
        covariances[:, DISTURBANCE, POSE] = by_slopes[:, :, DISTURBANCE].swapaxes(1, 2)
        covariances[:, POSE, POSE] = by_slopes @ slopes.swapaxes(1, 2)
        variances = np.einsum("kii->ki", covariances)  # a view, however they lie in memory
        variances[:, POSE] += (self._process + self._config.distance_noise**2 * abs(v_m_s)) * duration_s
        variances[:, DISTURBANCE] += known.kinds * (self._walk * (self._drifting * duration_s))
        doubt = self._fade.variance(v_m_s)
        if doubt > 0.0:
            variances[:, 5:] += doubt * known.kinds[:, 2:] * np.square(known.states[:, 5:])
        return covariances

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
        seen, slopes, depth = self._array.project(self._known.states[:, POSE])
        seen, slopes = seen.reshape(len(seen), -1), slopes.reshape(len(seen), -1, 3)
        ahead = depth.min(axis=1) > 0.0
        if not ahead.all():
            if not ahead.any():
                return np.zeros(len(features), dtype=bool)
            self._known = self._known.take(np.flatnonzero(ahead))
            seen, slopes = seen[ahead], slopes[ahead]
        known = self._known
        measured = features.T.reshape(-1)
        unseen = ~np.isfinite(measured)
        residual = (measured - seen) / sigma_normalised
        slopes /= sigma_normalised
        visible = ~(unseen[: len(features)] | unseen[len(features) :])
        if not visible.all():
            residual[:, np.tile(~visible, 2)] = 0.0
        used, chi2 = _gate(residual, slopes, known.covariances[:, POSE, POSE], visible)
        if not used.all():
            rows = np.concatenate([used, used], axis=1)
            residual, slopes = residual * rows, slopes * rows[:, :, None]
        if heading is not None:
            slopes[:, :, 2] = 0.0  # θ comes from there alone
        by_slopes = slopes.swapaxes(1, 2)
        information = by_slopes @ slopes
        vector = (by_slopes @ residual[:, :, None])[:, :, 0]
        if heading is not None:
            apart = np.remainder(heading[0] + math.pi - known.states[:, 2], 2 * math.pi) - math.pi
            information[:, 2, 2] = 1.0 / heading[1] ** 2
            vector[:, 2] = apart / heading[1] ** 2
            chi2 = chi2 + np.square(apart / heading[1])
        self._correct(information, vector, chi2)
        likeliest = known.likeliest
        self._branch()
        self._mean = None
        return np.asarray(used[likeliest])

    def _correct(self, information: Array, vector: Array, chi2: Array) -> None:
        """Kalman update in information form: (k, 3, 3) JᵀJ and (k, 3) Jᵀr of whitened rows, (k,) rᵀr."""
        known = self._known
        columns = known.covariances[:, :, POSE]
        mixed = information @ columns[:, POSE]
        mixed.reshape(len(mixed), 9)[:, ::4] += 1.0
        inverse, determinant = _inverse(mixed)
        gain = columns @ inverse
        change = (gain @ vector[:, :, None])[:, :, 0]
        states = known.states + change
        disturbance = states[:, DISTURBANCE]
        np.minimum(np.maximum(disturbance, -self._bound, out=disturbance), self._bound, out=disturbance)
        known.states = states
        covariances = known.covariances - gain @ (information @ columns.swapaxes(1, 2))
        known.covariances = 0.5 * (covariances + covariances.swapaxes(1, 2))
        explained = (vector * change[:, POSE]).sum(axis=1)
        log_weights = known.log_weights - 0.5 * (chi2 - explained + np.log(determinant))
        known.log_weights = log_weights - log_weights.max()

    def _branch(self) -> None:
        since_s = (self._time_ns - self._branched_ns) / NS_PER_S
        if since_s < BRANCH_EVERY_S:
            return
        self._branched_ns = self._time_ns
        if self._drifting > DRIVING:
            self._known = self._branching.branch(self._known, self._by_disturbance, since_s)
        else:
            self._known = self._branching.prune(self._known)


def _gate(residual: Array, slopes: Array, covariances: Array, visible: Mask) -> tuple[Mask, Array]:
    """(k, n) which points each history explains, and (k,) χ² of those, with what the others are charged."""
    count = len(visible)
    alpha, beta = residual[:, :count], residual[:, count:]
    alone = alpha * alpha + beta * beta
    if alone.max() <= GATE_CHI2:  # what the pose's own uncertainty explains only lessens it
        return np.broadcast_to(visible, alone.shape), alone.sum(axis=1)
    by_pose = slopes @ covariances
    variance = 1.0 + (by_pose * slopes).sum(axis=2)
    a, d = variance[:, :count], variance[:, count:]
    b = (by_pose[:, :count] * slopes[:, count:]).sum(axis=2)
    chi2 = (d * alpha * alpha - 2 * b * alpha * beta + a * beta * beta) / (a * d - b * b)
    used = (chi2 <= GATE_CHI2) & visible
    return used, (used * alone).sum(axis=1) + GATE_CHI2 * (visible & ~used).sum(axis=1)


def _inverse(matrices: Array) -> tuple[Array, Array]:
    """Inverse and determinant of (k, 3, 3), by cofactors: a third of the time of LAPACK's, one call for each."""
    flat = matrices.reshape(-1, 9)
    cofactors = flat[:, _FIRST] * flat[:, _SECOND] - flat[:, _THIRD] * flat[:, _FOURTH]
    determinant = (flat[:, ::3] * cofactors[:, :3]).sum(axis=1)
    return (cofactors / determinant[:, None]).reshape(-1, 3, 3), determinant


# entry (i, j) of the adjugate is the cofactor (j, i), with the minor's rows and columns taken in cyclic order
_CYCLE = [((i + 1) % 3, (i + 2) % 3) for i in range(3)]
_FIRST = np.array([3 * _CYCLE[j][0] + _CYCLE[i][0] for i in range(3) for j in range(3)])
_SECOND = np.array([3 * _CYCLE[j][1] + _CYCLE[i][1] for i in range(3) for j in range(3)])
_THIRD = np.array([3 * _CYCLE[j][0] + _CYCLE[i][1] for i in range(3) for j in range(3)])
_FOURTH = np.array([3 * _CYCLE[j][1] + _CYCLE[i][0] for i in range(3) for j in range(3)])


def _pose(state: Array) -> Pose2:
    return Pose2(float(state[0]), float(state[1]), float(state[2]))
