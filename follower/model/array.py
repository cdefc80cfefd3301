"""The LED array through the Follower's camera, with its derivatives: the projection of estimation and control.

Eq. (4), a point of {L} in {C}; then the camera's own tilt away from its mounting; then eq. (7), division by depth.
Three ways to the same numbers, held to each other and to finite differences by a test: many poses of a level camera,
many states of a tilted one, and one LED in plain floats, which for the few LEDs of a frame takes a quarter of the
time.
"""

from __future__ import annotations

import math

import numpy as np

from common.geometry import Array, Pose2

NEAREST_M = 0.05  # depth below which a tilted camera's LED is no longer in front of it

Floats = tuple[float, ...] | list[float]


class LedArray:
    """LEDs and camera, for many states at once.

    A state is ``[x, y, θ]``, the pose of {L} in {F} [m, m, rad], for a level camera, or ``[x, y, θ, pitch, roll]``
    with its tilt [rad]: pitch positive looks up, roll positive lowers the right.

    Args:
        points_l: (n, 3) LEDs in {L} [m].
        camera_xyz_m: ξ, the optical centre in {F} [m].
    """

    def __init__(self, points_l: Array, camera_xyz_m: Array) -> None:
        self._camera_x, self._camera_y, camera_z = camera_xyz_m
        self._places = points_l[:, 0] + 1j * points_l[:, 1]
        self._heights = camera_z - points_l[:, 2]

    def features(self, poses: Array) -> tuple[Array, Array]:
        """Features from poses of a level camera.

        Args:
            poses: (k, ≥ 3) ``[x, y, θ]``.

        Returns:
            (k, 2, n) normalised, all α before all β, and the depths (k, n) [m]; the features mean nothing where a
            depth is not positive.
        """
        along, left = self._turned(poses)
        depth = along + (poses[:, 0:1] - self._camera_x)
        return self._level(poses, left, 1.0 / depth), depth

    def project(self, states: Array) -> tuple[Array, Array, Array]:
        """Features and their derivatives by the states.

        Args:
            states: (k, 3) for a level camera, (k, 5) for a tilted one.

        Returns:
            Features (k, 2, n) normalised, all α before all β; their derivatives (k, 2, n, 3 or 5); depths (k, n) [m].
            Features mean nothing where a depth is not positive (level) or below ``NEAREST_M`` (tilted).
        """
        return self._tilted_slopes(states) if states.shape[1] == 5 else self._level_slopes(states)

    def _turned(self, states: Array) -> tuple[Array, Array]:
        """How far each LED lies ahead and to the left of {L}'s origin, along the axes of {F}, (k, n) each."""
        turned = np.exp(1j * states[:, 2:3]) * self._places
        return turned.real, turned.imag

    def _level(self, states: Array, left: Array, inverse: Array) -> Array:
        seen = np.empty((len(states), 2, left.shape[1]))
        seen[:, 0] = (self._camera_y - states[:, 1:2] - left) * inverse
        seen[:, 1] = self._heights * inverse
        return seen

    def _level_slopes(self, states: Array) -> tuple[Array, Array, Array]:
        along, left = self._turned(states)
        depth = along + (states[:, 0:1] - self._camera_x)
        inverse = 1.0 / depth
        seen = self._level(states, left, inverse)
        slopes = np.zeros((*seen.shape, 3))
        by_depth = seen * inverse[:, None]
        slopes[:, :, :, 0] = -by_depth
        slopes[:, 0, :, 1] = -inverse
        by_depth *= left[:, None]
        by_depth[:, 0] -= along * inverse
        slopes[:, :, :, 2] = by_depth
        return seen, slopes, depth

    def _tilted_slopes(self, states: Array) -> tuple[Array, Array, Array]:
        forward, left = self._turned(states)
        cp, sp = np.cos(states[:, 3:4]), np.sin(states[:, 3:4])
        cr, sr = np.cos(states[:, 4:5]), np.sin(states[:, 4:5])
        x = (self._camera_y - states[:, 1:2]) - left
        y = self._heights
        z = (states[:, 0:1] - self._camera_x) + forward
        # the camera's tilt: pitch, then roll
        y1, depth = y * cp + z * sp, z * cp - y * sp
        inverse = 1.0 / np.maximum(depth, NEAREST_M)
        seen = np.empty((len(states), 2, left.shape[1]))
        seen[:, 0], seen[:, 1] = (x * cr + y1 * sr) * inverse, (y1 * cr - x * sr) * inverse
        alpha, beta = seen[:, 0], seen[:, 1]
        # those of X and Z by θ are −forward and −left
        slopes = np.empty((*seen.shape, 5))
        top, bottom = slopes[:, 0], slopes[:, 1]
        top[:, :, 0] = (sp * sr - alpha * cp) * inverse
        bottom[:, :, 0] = (sp * cr - beta * cp) * inverse
        top[:, :, 1] = -cr * inverse
        bottom[:, :, 1] = sr * inverse
        top[:, :, 2] = (left * (alpha * cp - sp * sr) - forward * cr) * inverse
        bottom[:, :, 2] = (left * (beta * cp - sp * cr) + forward * sr) * inverse
        lift = y1 * inverse
        top[:, :, 3] = alpha * lift + sr * depth * inverse
        bottom[:, :, 3] = beta * lift + cr * depth * inverse
        top[:, :, 4] = beta
        bottom[:, :, 4] = -alpha
        return seen, slopes, depth


def feature_jacobian(points_l: Array, leader_in_follower: Pose2, camera_xyz_m: Array) -> Array:
    """Derivatives of the features by the pose, from one pose of a level camera.

    Args:
        points_l: (n, 3) LEDs in {L} [m].
        leader_in_follower: the pose of {L} in {F}.
        camera_xyz_m: ξ, the optical centre in {F} [m].

    Returns:
        ∂s/∂(x, y, θ), (2n, 3), rows α_0, β_0, α_1 …
    """
    _, slopes, _ = LedArray(points_l, camera_xyz_m).project(leader_in_follower.as_array()[None])
    return led_by_led(slopes[0])


def led_by_led(values: Array) -> Array:
    """Rows all α before all β in the order α_0, β_0, α_1 …, (2n, …).

    Args:
        values: (2, n, …).
    """
    return values.swapaxes(0, 1).reshape(-1, *values.shape[2:])


def tilt_of(state: Floats) -> tuple[float, ...]:
    """Cosine and sine of θ, pitch and roll, as :func:`project_led` takes them.

    Args:
        state: x, y [m], θ, pitch, roll [rad].
    """
    return tuple(part for angle in state[2:] for part in (math.cos(angle), math.sin(angle)))


def project_led(
    point: Floats, state: Floats, mount: Floats, tilt: tuple[float, ...]
) -> tuple[list[float], list[float], float, float, float]:
    """One LED through a tilted camera, in plain floats.

    Args:
        point: the LED in {L} [m].
        state: x, y [m], θ, pitch, roll [rad].
        mount: ξ, the optical centre in {F} [m].
        tilt: of that state, from :func:`tilt_of`.

    Returns:
        Derivatives of α and of β by the state, five each; α, β; the depth [m].
    """
    c, s, cp, sp, cr, sr = tilt
    forward = point[0] * c - point[1] * s
    left = point[0] * s + point[1] * c
    x = mount[1] - state[1] - left
    y = mount[2] - point[2]
    z = state[0] - mount[0] + forward
    y1, depth = y * cp + z * sp, z * cp - y * sp
    x2, y2 = x * cr + y1 * sr, y1 * cr - x * sr
    inverse = 1.0 / max(depth, NEAREST_M)
    alpha, beta = x2 * inverse, y2 * inverse
    lift, straight = y1 * inverse, depth * inverse
    by_alpha = [
        (sp * sr - alpha * cp) * inverse,
        -cr * inverse,
        (left * (alpha * cp - sp * sr) - forward * cr) * inverse,
        alpha * lift + sr * straight,
        beta,
    ]
    by_beta = [
        (sp * cr - beta * cp) * inverse,
        sr * inverse,
        (left * (beta * cp - sp * cr) + forward * sr) * inverse,
        beta * lift + cr * straight,
        -alpha,
    ]
    return by_alpha, by_beta, alpha, beta, depth
