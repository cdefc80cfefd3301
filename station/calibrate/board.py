"""The chessboard of a lens calibration: its corners in an image, and how much of the image many views cover."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from common.frames.ring import Image
from common.geometry import Array

Size = tuple[int, int]

_FEWEST_VIEWS = 8
_SMALLEST_IMAGE_PX = 32  # OpenCV's search raises below some 15
_GRID = 6
_LEAST_SHARE = 0.55
_REGIONS = (("top left", "top", "top right"), ("left", "centre", "right"), ("bottom left", "bottom", "bottom right"))


@dataclass(frozen=True)
class Board:
    """A chessboard's inner corners and the side of a square [m]."""

    columns: int
    rows: int
    square_m: float

    def points(self) -> Array:
        """Corners (columns·rows, 3) on the board [m], row by row."""
        grid = np.mgrid[0 : self.columns, 0 : self.rows].T.reshape(-1, 2) * self.square_m
        return np.column_stack([grid, np.zeros(len(grid))])


@dataclass(frozen=True)
class Coverage:
    """Where in the image corners were seen: share of a 6×6 grid, and the regions that lack them."""

    share: float
    missing: tuple[str, ...]


def find_corners(image: Image, board: Board) -> Array | None:
    """Find the board's inner corners, to a few hundredths of a pixel.

    Args:
        image: (height, width) grey.
        board: what to find.

    Returns:
        (n, 2) [px], row by row of the board; None if it is not all there.
    """
    if min(image.shape) < _SMALLEST_IMAGE_PX:
        return None
    found, corners = cv2.findChessboardCorners(
        image, (board.columns, board.rows), flags=cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
    )
    if not found:
        return None
    raw = np.asarray(corners, np.float32).reshape(-1, 2)
    nearest = float(np.linalg.norm(np.diff(raw, axis=0), axis=1).min())
    half = int(np.clip(0.4 * nearest, 2, 11))
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 60, 1e-4)
    refined = cv2.cornerSubPix(image, raw.reshape(-1, 1, 2), (half, half), (-1, -1), criteria)
    return np.asarray(refined, dtype=np.float64).reshape(-1, 2)


def counted_otherwise(image: Image, board: Board) -> str:
    """What to say of an image in which the board is found once its squares are not taken for its corners; "" if not.

    Args:
        image: (height, width) grey, in which the board is not found.
        board: what was looked for.
    """
    for fewer, lower in ((1, 1), (1, 0), (0, 1)):
        columns, rows = board.columns - fewer, board.rows - lower
        if min(columns, rows) > 2 and find_corners(image, Board(columns, rows, board.square_m)) is not None:
            return (
                f"shows a board of {columns}x{rows} inner corners, not of {board.columns}x{board.rows}: does --board "
                f"count inner corners? a board of {columns + 1}x{rows + 1} squares has {columns}x{rows}"
            )
    return ""


def covered_cells(views: Sequence[Array], size: Size) -> NDArray[np.bool_]:
    """Which cells (6, 6) of an image of (width, height), from the top left, have seen a corner."""
    cells = np.zeros((_GRID, _GRID), dtype=np.bool_)
    for corners in views:
        columns, rows = np.clip(corners * _GRID / np.array(size), 0, _GRID - 1).astype(int).T
        cells[rows, columns] = True
    return cells


def lacking(views: Sequence[Array], size: Size) -> str:
    """What these views still lack for a calibration; empty if nothing."""
    if len(views) < _FEWEST_VIEWS:
        return f"{len(views)} images with the whole board, at least {_FEWEST_VIEWS} are needed"
    coverage = coverage_of(views, size)
    if coverage.missing:
        return f"no board seen in these parts of the image: {', '.join(coverage.missing)}"
    if coverage.share < _LEAST_SHARE:
        return f"boards cover {coverage.share:.0%} of the image, {_LEAST_SHARE:.0%} are needed: go farther out"
    return ""


def coverage_of(views: Sequence[Array], size: Size) -> Coverage:
    """Where corners of all views lie in an image of (width, height)."""
    cells = covered_cells(views, size)
    missing = tuple(
        _REGIONS[row][column]
        for row in range(3)
        for column in range(3)
        if cells[2 * row : 2 * row + 2, 2 * column : 2 * column + 2].sum() < 1
    )
    return Coverage(float(cells.mean()), missing)
