"""Ideal wide-angle lenses by the projection laws that they are designed for, independent of any calibration model."""

from __future__ import annotations

from typing import Literal

import numpy as np

from common.geometry import Array

Law = Literal["rectilinear", "stereographic", "equidistant"]


def image_by_law(rays_c: Array, law: Law, size_px: tuple[int, int], field_of_view_rad: float) -> Array:
    """Pixels (n, 2) of rays (n, 3) through an ideal lens of the given law whose image is as wide as its field."""
    centre = 0.5 * (np.array(size_px) - 1.0)
    focal = centre[0] / float(_radius(np.array(0.5 * field_of_view_rad), law))
    aside = np.hypot(rays_c[:, 0], rays_c[:, 1])
    angle = np.arctan2(aside, rays_c[:, 2])
    radius = focal * _radius(angle, law)
    direction = rays_c[:, :2] / np.maximum(aside, 1e-12)[:, None]
    return np.asarray(direction * radius[:, None] + centre)


def _radius(angle_rad: Array, law: Law) -> Array:
    """Distance from the image's centre over the focal length at an angle to the axis."""
    if law == "rectilinear":
        return np.tan(angle_rad)
    return 2.0 * np.tan(0.5 * angle_rad) if law == "stereographic" else angle_rad
