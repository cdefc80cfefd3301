"""Lens and mounting between {Π} and {I}: points are undistorted and levelled, never images.

{I} belongs to a camera that looks straight ahead; how the real one is screwed on is taken out here, once.
"""

from __future__ import annotations

import cv2
import numpy as np

from common.config import CameraConfig
from common.geometry import Array

_CRITERIA = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 40, 1e-9)


class Lens:
    """Pixels ↔ normalised coordinates of a pinhole, a rational (8 coefficients) or a fisheye (4) lens."""

    def __init__(self, camera: CameraConfig) -> None:
        self.pinhole = camera.pinhole
        self._model = camera.lens.model
        self._matrix = camera.pinhole.matrix()
        self._coefficients = np.array(camera.lens.coefficients)
        # {C} as mounted from {C} looking straight ahead
        self._turn = mounting_rotation(camera.mount_tilt) if camera.mount_tilt.any() else None

    def to_normalised(self, pixels: Array) -> Array:
        """{Π} → {I}, (n, 2).

        Args:
            pixels: (n, 2) [px].
        """
        seen = self._undistorted(pixels)
        return seen if self._turn is None else _turned(seen, self._turn.T)

    def to_pixels(self, normalised: Array) -> Array:
        """{I} → {Π}, (n, 2) [px].

        Args:
            normalised: (n, 2).
        """
        return self._distorted(normalised if self._turn is None else _turned(normalised, self._turn))

    def _undistorted(self, pixels: Array) -> Array:
        if self._model == "pinhole" or not len(pixels):
            return self.pinhole.to_normalised(pixels)
        points = np.ascontiguousarray(pixels, dtype=np.float64).reshape(-1, 1, 2)
        if self._model == "rational":
            ideal = cv2.undistortPoints(points, self._matrix, self._coefficients, criteria=_CRITERIA)
        else:
            ideal = cv2.fisheye.undistortPoints(points, self._matrix, self._coefficients, criteria=_CRITERIA)
        return np.asarray(ideal, dtype=np.float64).reshape(-1, 2)

    def _distorted(self, normalised: Array) -> Array:
        if self._model == "pinhole" or not len(normalised):
            return self.pinhole.to_pixels(normalised)
        if self._model == "rational":
            rays = np.column_stack([normalised, np.ones(len(normalised))])
            zero = np.zeros(3)
            pixels, _ = cv2.projectPoints(rays, zero, zero, self._matrix, self._coefficients)
        else:
            ideal = np.ascontiguousarray(normalised, dtype=np.float64).reshape(-1, 1, 2)
            pixels = cv2.fisheye.distortPoints(ideal, self._matrix, self._coefficients)
        return np.asarray(pixels, dtype=np.float64).reshape(-1, 2)


def mounting_rotation(tilt_rad: Array) -> Array:
    """(3, 3) that takes coordinates in {C} looking straight ahead to {C} as mounted: yaw, then pitch, then roll.

    Args:
        tilt_rad: (3,) pitch, roll, yaw.
    """
    (cp, cr, cy), (sp, sr, sy) = np.cos(tilt_rad), np.sin(tilt_rad)
    yaw = np.array([[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]])
    pitch = np.array([[1.0, 0.0, 0.0], [0.0, cp, sp], [0.0, -sp, cp]])
    roll = np.array([[cr, sr, 0.0], [-sr, cr, 0.0], [0.0, 0.0, 1.0]])
    rotation: Array = roll @ pitch @ yaw
    return rotation


def _turned(normalised: Array, rotation: Array) -> Array:
    rays = np.column_stack([normalised, np.ones(len(normalised))]) @ rotation.T
    turned: Array = rays[:, :2] / rays[:, 2:]
    return turned
