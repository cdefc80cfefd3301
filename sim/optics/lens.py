"""The simulated lens: forward distortion of each lens model, written out for a few points."""

from __future__ import annotations

import numpy as np

from common.config import CameraConfig
from common.geometry import Array


def image_of_rays(rays_c: Array, camera: CameraConfig) -> Array:
    """Project rays through the camera's lens.

    Args:
        rays_c: (n, 3) directions in {C}, z > 0.
        camera: with its lens model.

    Returns:
        (n, 2) pixels.
    """
    lens = camera.lens
    ideal = rays_c[:, :2] / rays_c[:, 2:]
    if lens.model == "rational":
        ideal = _rational(ideal, lens.coefficients)
    elif lens.model == "fisheye":
        ideal = _fisheye(ideal, lens.coefficients)
    return ideal * [lens.fx_px, lens.fy_px] + [lens.cx_px, lens.cy_px]


def _rational(ideal: Array, coefficients: tuple[float, ...]) -> Array:
    """OpenCV's rational model: k1 k2 p1 p2 k3 k4 k5 k6."""
    k1, k2, p1, p2, k3, k4, k5, k6 = coefficients
    x, y = ideal[:, 0], ideal[:, 1]
    r2 = x * x + y * y
    radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    return np.stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
        ],
        axis=1,
    )


def _fisheye(ideal: Array, coefficients: tuple[float, ...]) -> Array:
    """OpenCV's fisheye model: the angle to the axis through an odd polynomial."""
    radius = np.hypot(ideal[:, 0], ideal[:, 1])
    angle = np.arctan(radius)
    square = angle**2
    k1, k2, k3, k4 = coefficients
    bent = angle * (1 + square * (k1 + square * (k2 + square * (k3 + square * k4))))
    scale = np.where(radius > 1e-9, bent / np.maximum(radius, 1e-9), 1.0)
    return ideal * scale[:, None]
