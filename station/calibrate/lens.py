"""``davpc calibrate camera``: lens from images of a chessboard, the best of three kinds by corners it has not seen.

The filter blocks visible light: light the board evenly with a diffuse 940 nm source beside the camera, never with a
torch at the lens. A small reprojection error alone proves little at 120°: what counts is that the corners of the
image were covered, and how well corners of held-out images are predicted. A narrow lens does not determine all eight
coefficients of the rational model: what they are left to do where no corner was seen can be a pole inside the image,
beside which one pixel is many rays. Such a lens is not taken, however small its error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from common.config import LensConfig
from common.geometry import Array
from station.calibrate.board import Board, Coverage, Size, coverage_of, lacking

Kind = Literal["rational", "polynomial", "fisheye"]  # polynomial: rational with a denominator of 1
KINDS: tuple[Kind, ...] = ("rational", "polynomial", "fisheye")

_FOLDS = 4
_FIELDS_OF_VIEW_RAD = np.radians([115.0, 60.0, 85.0, 135.0])
_GOOD_PX = 0.4
_LEAST_SPREAD_RAD = np.radians(5.0)
_MOST_ASPECT = 0.01
_MOST_COEFFICIENT = 1e4  # of LensConfig: a fit beyond it has diverged
_FISHEYE_FLAGS = cv2.CALIB_RECOMPUTE_EXTRINSIC | cv2.CALIB_FIX_SKEW | cv2.CALIB_USE_INTRINSIC_GUESS
_RATIONAL_FLAGS = cv2.CALIB_RATIONAL_MODEL | cv2.CALIB_USE_INTRINSIC_GUESS
_POLYNOMIAL_FLAGS = _RATIONAL_FLAGS | cv2.CALIB_FIX_K4 | cv2.CALIB_FIX_K5 | cv2.CALIB_FIX_K6
_ANGLES_RAD = np.radians(np.arange(0.02, 88.5, 0.02))


class CalibrationError(Exception):
    """Images from which no lens can be determined; one line that names what is missing."""


@dataclass(frozen=True)
class Calibration:
    """A lens and how far to trust it.

    Attributes:
        lens: the chosen one.
        rms_px: reprojection error over all corners.
        held_out_px: over corners of images that were left out of the fit, by kind; the least decided. Kinds that
            do not fit, or do not hold over the whole image, are missing.
        coverage: where corners were seen.
        views: images used.
    """

    lens: LensConfig
    rms_px: float
    held_out_px: dict[Kind, float]
    coverage: Coverage
    views: int

    @property
    def doubt(self) -> str:
        """What to check although the lens fits; "" if nothing."""
        aspect = self.lens.fx_px / self.lens.fy_px - 1.0
        if abs(aspect) <= _MOST_ASPECT:
            return ""
        return f"fx and fy differ by {100 * abs(aspect):.1f} %: is the board printed in proportion?"

    @property
    def kind(self) -> Kind:
        """The chosen kind."""
        return min(self.held_out_px, key=lambda kind: self.held_out_px[kind])


def calibrate_camera(views: Sequence[Array], board: Board, size: Size) -> Calibration:
    """Fit every kind of lens, choose by held-out corners among those that hold over the whole image.

    Args:
        views: corners (n, 2) [px] of each image, from :func:`find_corners`.
        board: what was photographed.
        size: (width, height) of the images [px].

    Raises:
        CalibrationError: too few views, regions without corners, boards that are not tilted, or no kind fits.
    """
    missing = lacking(views, size)
    if missing:
        raise CalibrationError(missing)
    fitted: dict[Kind, tuple[LensConfig, float]] = {}
    held_out: dict[Kind, float] = {}
    for kind in KINDS:
        fit = fit_lens(kind, views, board, size)
        if fit is None or not holds(fit[0], size):
            continue
        errors = [_held_out(kind, views, board, size, fold) for fold in range(_FOLDS)]
        squares = [error**2 for error in errors if error is not None]
        if len(squares) == _FOLDS:
            fitted[kind], held_out[kind] = fit, float(np.sqrt(np.mean(squares)))
    if not fitted:
        raise CalibrationError(
            "no model fits and holds over the whole image: are all images of one camera and board? show the board "
            "farther out in the image's corners"
        )
    best = min(held_out, key=lambda kind: held_out[kind])
    lens, rms_px = fitted[best]
    turned_rad = board_spread_rad(lens, views, board)
    if turned_rad < _LEAST_SPREAD_RAD:
        raise CalibrationError(
            f"the boards are not tilted (their directions differ by {np.degrees(turned_rad):.1f}° rms, "
            f"{np.degrees(_LEAST_SPREAD_RAD):.0f}° are needed): the views do not determine the focal length"
        )
    return Calibration(lens, rms_px, held_out, coverage_of(views, size), len(views))


def board_spread_rad(lens: LensConfig, views: Sequence[Array], board: Board) -> float:
    """Rms angle [rad] of the boards' normals about their mean: boards that are parallel leave the focal length open.

    Args:
        lens: as fitted; the angles of parallel boards are small with a wrong focal length too.
        views: corners (n, 2) [px] of each image.
        board: what was photographed.
    """
    normals = []
    for corners in views:
        found, turn, _ = cv2.solvePnP(board.points(), rays(lens, corners), np.eye(3), np.zeros(0))
        if found:
            normals.append(np.asarray(cv2.Rodrigues(turn)[0], np.float64)[:, 2])
    if not normals:
        return 0.0
    mean = np.mean(normals, axis=0)
    cosines = np.array(normals) @ (mean / max(float(np.linalg.norm(mean)), 1e-9))
    return float(np.sqrt(np.mean(np.arccos(np.clip(cosines, -1.0, 1.0)) ** 2)))


def fit_lens(kind: Kind, views: Sequence[Array], board: Board, size: Size) -> tuple[LensConfig, float] | None:
    """Fit a lens of one kind, from the first field of view that leads to a good fit.

    Args:
        kind: of the lens.
        views: corners (n, 2) [px] of each image.
        board: what was photographed.
        size: (width, height) of the images [px].

    Returns:
        The lens and its reprojection rms [px]; None if no first guess converges.
    """
    best: tuple[LensConfig, float] | None = None
    for field in _FIELDS_OF_VIEW_RAD:
        fit = _fit_from(kind, _guess(kind, size, float(field)), views, board, size)
        if fit is not None and (best is None or fit[1] < best[1]):
            best = fit
        if best is not None and best[1] < _GOOD_PX:
            break
    return best


def holds(lens: LensConfig, size: Size) -> bool:
    """Whether each pixel of an image of (width, height) is one ray: the distance from the centre grows with the
    angle to the axis, without a pole, until the farthest corner or, of a fisheye, until 90°.
    """
    if lens.model == "pinhole":
        return True
    ends = np.array([(x, y) for x in (0, size[0] - 1) for y in (0, size[1] - 1)])
    farthest = float(np.hypot(*((ends - (lens.cx_px, lens.cy_px)) / (lens.fx_px, lens.fy_px)).T).max())
    if lens.model == "fisheye":
        radius = (np.array([1.0, *lens.coefficients]) * _ANGLES_RAD[:, None] ** np.arange(1, 10, 2)).sum(axis=1)
        below = np.ones(len(radius))
    else:
        k1, k2, _, _, k3, k4, k5, k6 = lens.coefficients
        ideal = np.tan(_ANGLES_RAD)
        square = ideal**2
        below = 1.0 + square * (k4 + square * (k5 + square * k6))
        radius = ideal * (1.0 + square * (k1 + square * (k2 + square * k3))) / below
    wrong = (below <= 0.0) | (np.diff(radius, prepend=0.0) <= 0.0)
    first_wrong = int(np.argmax(wrong)) if wrong.any() else len(wrong)
    reached = bool((radius[:first_wrong] >= farthest).any())
    return reached or (lens.model == "fisheye" and not wrong.any())


def project(lens: LensConfig, points_c: Array) -> Array:
    """Project points through a lens.

    Args:
        lens: model and coefficients.
        points_c: (n, 3) in {C} [m].

    Returns:
        (n, 2) [px].
    """
    zero, coefficients = np.zeros(3), np.array(lens.coefficients)
    if lens.model == "fisheye":
        pixels, _ = cv2.fisheye.projectPoints(points_c.reshape(1, -1, 3), zero, zero, _matrix(lens), coefficients)
    else:
        pixels, _ = cv2.projectPoints(points_c.reshape(-1, 1, 3), zero, zero, _matrix(lens), coefficients)
    return np.asarray(pixels, dtype=np.float64).reshape(-1, 2)


def rays(lens: LensConfig, pixels: Array) -> Array:
    """Undistort pixels.

    Args:
        lens: model and coefficients.
        pixels: (n, 2) [px].

    Returns:
        (n, 2) normalised coordinates.
    """
    points, coefficients = pixels.reshape(-1, 1, 2), np.array(lens.coefficients)
    if lens.model == "fisheye":
        ideal = cv2.fisheye.undistortPoints(points, _matrix(lens), coefficients)
    else:
        ideal = cv2.undistortPoints(points, _matrix(lens), coefficients, criteria=(3, 60, 1e-10))
    return np.asarray(ideal, dtype=np.float64).reshape(-1, 2)


def _guess(kind: Kind, size: Size, field_of_view_rad: float) -> LensConfig:
    """An undistorted lens of the given horizontal field of view."""
    half, angle = 0.5 * size[0], 0.5 * field_of_view_rad
    focal = half / angle if kind == "fisheye" else half / float(np.tan(angle))
    matrix = np.array([[focal, 0.0, 0.5 * size[0]], [0.0, focal, 0.5 * size[1]], [0.0, 0.0, 1.0]])
    return _lens(kind, matrix, np.zeros(8))


def _fit_from(
    kind: Kind, start: LensConfig, views: Sequence[Array], board: Board, size: Size
) -> tuple[LensConfig, float] | None:
    known, bent_before = _matrix(start), np.array(start.coefficients)
    try:
        if kind == "fisheye":
            objects = [board.points().reshape(1, -1, 3)] * len(views)
            images = [corners.reshape(1, -1, 2) for corners in views]
            rms, raw_matrix, raw_bent, _, _ = cv2.fisheye.calibrate(
                objects, images, size, known, bent_before, flags=_FISHEYE_FLAGS
            )
        else:
            flat = [board.points().astype(np.float32).reshape(-1, 1, 3)] * len(views)
            seen = [corners.astype(np.float32).reshape(-1, 1, 2) for corners in views]
            flags = _POLYNOMIAL_FLAGS if kind == "polynomial" else _RATIONAL_FLAGS
            rms, raw_matrix, raw_bent, _, _ = cv2.calibrateCamera(flat, seen, size, known, bent_before, flags=flags)
    except cv2.error:
        return None  # this first guess leads nowhere; others may
    matrix, bent = np.asarray(raw_matrix, np.float64), np.asarray(raw_bent, np.float64).ravel()
    if not np.isfinite([*matrix.ravel(), *bent, rms]).all() or matrix[0, 0] <= 0.0 or matrix[1, 1] <= 0.0:
        return None
    if np.abs(bent).max() > _MOST_COEFFICIENT:
        return None
    return _lens(kind, matrix, bent), float(rms)


def _held_out(kind: Kind, views: Sequence[Array], board: Board, size: Size, fold: int) -> float | None:
    """Reprojection rms [px] over every fourth view, with the lens of the others and each board's own pose.

    The lens is fitted from scratch: a start from all views would carry over the corners that are left out.
    """
    kept = [corners for row, corners in enumerate(views) if row % _FOLDS != fold]
    fitted = fit_lens(kind, kept, board, size)
    if fitted is None:
        return None
    squares = []
    for corners in views[fold::_FOLDS]:
        ideal = rays(fitted[0], corners)
        found, turn, shift = cv2.solvePnP(board.points(), ideal, np.eye(3), np.zeros(0), flags=cv2.SOLVEPNP_ITERATIVE)
        if not found:
            return None
        points_c = board.points() @ cv2.Rodrigues(turn)[0].T + shift.ravel()
        squares.append(((project(fitted[0], points_c) - corners) ** 2).sum(axis=1))
    return float(np.sqrt(np.concatenate(squares).mean()))


def _lens(kind: Kind, matrix: Array, bent: Array) -> LensConfig:
    count = 4 if kind == "fisheye" else 8
    return LensConfig(
        model="fisheye" if kind == "fisheye" else "rational",
        fx_px=float(matrix[0, 0]),
        fy_px=float(matrix[1, 1]),
        cx_px=float(matrix[0, 2]),
        cy_px=float(matrix[1, 2]),
        coefficients=tuple(float(value) for value in bent[:count]),
    )


def _matrix(lens: LensConfig) -> Array:
    return np.array([[lens.fx_px, 0.0, lens.cx_px], [0.0, lens.fy_px, lens.cy_px], [0.0, 0.0, 1.0]])
