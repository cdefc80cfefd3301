"""Relative state from features and wheels: an extended Kalman filter in the pose of {L} in {F}.

The state moves by the exact solution of eq. (relative) for the measured wheel twist and is corrected by the
normalised features, eqs. (featurepoint) and (depthscale).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from common.config import EstimatorConfig
from common.geometry import Array, Pose2, features_at, move_relative, points_in_camera, wrap_angle
from common.timing import NS_PER_S

Mask = NDArray[np.bool_]

GATE_CHI2 = 16.0  # squared Mahalanobis distance of one point, 2 degrees of freedom: 1 in 3000 good ones is refused


def feature_jacobian(points_l: Array, relative: Pose2, camera_xyz_m: Array) -> Array:
    """∂s/∂(x, y, θ) of all features, (2n, 3): eqs. (featurepoint), (depthscale) differentiated."""
    c, s = math.cos(relative.theta_rad), math.sin(relative.theta_rad)
    points_c = points_in_camera(points_l, relative, camera_xyz_m)
    depth = points_c[:, 2]
    alpha, beta = points_c[:, 0] / depth, points_c[:, 1] / depth
    across_by_theta = -points_l[:, 0] * c + points_l[:, 1] * s
    depth_by_theta = -points_l[:, 0] * s - points_l[:, 1] * c
    rows = np.empty((len(points_l), 2, 3))
    rows[:, 0, 0], rows[:, 0, 1], rows[:, 0, 2] = -alpha, -1.0, across_by_theta - alpha * depth_by_theta
    rows[:, 1, 0], rows[:, 1, 1], rows[:, 1, 2] = -beta, 0.0, -beta * depth_by_theta
    jacobian: Array = (rows / depth[:, None, None]).reshape(-1, 3)
    return jacobian


class RelativeObserver:
    """Filtered pose of {L} in {F}. One instance per docking attempt; ``reset`` before anything else."""

    def __init__(self, points_l: Array, camera_xyz_m: Array, config: EstimatorConfig) -> None:
        self._points_l = points_l
        self._camera = camera_xyz_m
        self._config = config
        self._state = np.zeros(3)
        self._covariance = np.eye(3)
        self._time_ns = 0

    def reset(self, pose: Pose2, covariance: Array, time_ns: int) -> None:
        """Begin anew from a pose, its (3, 3) covariance [m, m, rad] and the time they belong to."""
        self._state = pose.as_array()
        self._covariance = np.array(covariance, dtype=float)
        self._time_ns = time_ns

    @property
    def pose(self) -> Pose2:
        """Estimated pose of {L} in {F} at the time of the last predict or reset."""
        return Pose2(*(float(value) for value in self._state))

    @property
    def covariance(self) -> Array:
        """(3, 3), of x [m], y [m], θ [rad]."""
        return self._covariance.copy()

    def pose_at(self, time_ns: int, v_m_s: float, w_rad_s: float) -> Pose2:
        """The pose at another time, nearby, if the wheels turn with this twist until then."""
        return move_relative(self.pose, v_m_s, w_rad_s, (time_ns - self._time_ns) / NS_PER_S)

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
        transition, by_twist = motion_jacobians(self._state, v_m_s, w_rad_s, duration_s)
        walk = np.diag(np.square(self._config.process_noise)) * duration_s
        relative = np.array(self._config.speed_noise) * [v_m_s, w_rad_s]
        speed = by_twist @ np.diag(relative**2 / duration_s) @ by_twist.T
        self._state = move_relative(self.pose, v_m_s, w_rad_s, duration_s).as_array()
        self._covariance = transition @ self._covariance @ transition.T + walk + speed
        self._time_ns = time_ns

    def update(self, features: Array, sigma_normalised: float) -> Mask:
        """Correct with the features of the image taken at the time of the last predict.

        Args:
            features: (n, 2) normalised coordinates, NaN for what was not seen.
            sigma_normalised: standard deviation of one coordinate.

        Returns:
            (n,) whether each point was used; not those unseen or outside the gate.
        """
        if np.any(points_in_camera(self._points_l, self.pose, self._camera)[:, 2] <= 0):
            return np.zeros(len(features), dtype=bool)
        residual = features - features_at(self._points_l, self.pose, self._camera)
        jacobian = feature_jacobian(self._points_l, self.pose, self._camera)
        used = self._inside_gate(residual, jacobian, sigma_normalised)
        rows = np.repeat(used, 2)
        if used.any():
            self._correct(residual.reshape(-1)[rows], jacobian[rows], sigma_normalised**2)
        return used

    def _inside_gate(self, residual: Array, jacobian: Array, sigma: float) -> Mask:
        inside: Mask = np.logical_and.reduce(np.isfinite(residual), axis=1)
        for i in np.flatnonzero(inside):
            block = jacobian[2 * i : 2 * i + 2]
            spread = block @ self._covariance @ block.T + sigma**2 * np.eye(2)
            inside[i] = residual[i] @ np.linalg.solve(spread, residual[i]) <= GATE_CHI2
        return inside

    def _correct(self, residual: Array, jacobian: Array, variance: float) -> None:
        """Joseph form, so that the covariance stays positive."""
        noise = variance * np.eye(len(residual))
        spread = jacobian @ self._covariance @ jacobian.T + noise
        gain = np.linalg.solve(spread, jacobian @ self._covariance).T
        self._state = self._state + gain @ residual
        self._state[2] = wrap_angle(self._state[2])
        left = np.eye(len(self._state)) - gain @ jacobian
        self._covariance = left @ self._covariance @ left.T + gain @ noise @ gain.T


def motion_jacobians(state: Array, v_m_s: float, w_rad_s: float, duration_s: float) -> tuple[Array, Array]:
    """Derivatives of :func:`common.geometry.move_relative` by the pose, (3, 3), and by [v, ω], (3, 2)."""
    turn = w_rad_s * duration_s
    c, s = math.cos(turn), math.sin(turn)
    transition = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    moved = transition[:2, :2] @ (state[:2] - _arc(v_m_s, turn, duration_s))
    along = transition[:2, :2] @ _arc(1.0, turn, duration_s)
    step = 1e-6
    bent = (_arc(v_m_s, turn + step, duration_s) - _arc(v_m_s, turn - step, duration_s)) / (2 * step)
    by_turn = np.array([moved[1], -moved[0]]) - transition[:2, :2] @ bent
    by_twist = np.array(
        [[-along[0], by_turn[0] * duration_s], [-along[1], by_turn[1] * duration_s], [0.0, -duration_s]]
    )
    return transition, by_twist


def _arc(v_m_s: float, turn_rad: float, duration_s: float) -> Array:
    """Chord of the arc driven, in the old {F}, (2,)."""
    chord = v_m_s * duration_s * float(np.sinc(turn_rad / (2 * math.pi)))
    return np.array([chord * math.cos(turn_rad / 2), chord * math.sin(turn_rad / 2)])
