"""The lens between {Π} and {I}: points are undistorted, never images."""

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

    def to_normalised(self, pixels: Array) -> Array:
        """{Π} → {I}, (n, 2)."""
        if self._model == "pinhole" or not len(pixels):
            return self.pinhole.to_normalised(pixels)
        points = np.ascontiguousarray(pixels, dtype=np.float64).reshape(-1, 1, 2)
        if self._model == "rational":
            ideal = cv2.undistortPoints(points, self._matrix, self._coefficients, criteria=_CRITERIA)
        else:
            ideal = cv2.fisheye.undistortPoints(points, self._matrix, self._coefficients, criteria=_CRITERIA)
        return np.asarray(ideal, dtype=np.float64).reshape(-1, 2)

    def to_pixels(self, normalised: Array) -> Array:
        """{I} → {Π}, (n, 2)."""
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
