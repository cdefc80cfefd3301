"""Is there an image at all: size, type, order in time, exposure; and does it show what the wheels do now."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from common.frames.ring import Image
from common.geometry import Array, interaction_matrix
from common.messages import StateCause
from common.timing import NS_PER_S
from follower.estimator.spots import background

_WHITE_PART = 0.05
_DARKEST = 0.5
_FROZEN_FRAMES = 3
_STILL_FRAMES = 5
# motion that must be expected of an LED, in standard deviations of a coordinate, and the path that must be driven for
# it: more than the gears' backlash; in how many LEDs; since when at most
_LEAST_SIGMAS, _LEAST_M, _FEWEST, _WINDOW_NS, _GAP_S = 1.0, 0.004, 2, NS_PER_S, 0.25
# share of the expected motion below which the image stands, in how many frames in a row; between which it follows
_STANDS, _CONFIRMED, _FOLLOWS = 0.2, 2, (0.5, 2.0)
_STANDING, _STOOD_NS = 0.01, NS_PER_S // 2  # m/s or rad/s


@dataclass(frozen=True)
class ImageReport:
    """``cause`` if the image cannot be used, ``exposure`` if it is badly lit, its median grey level."""

    cause: StateCause | None = None
    exposure: StateCause | None = None
    background: float = 0.0


class ImageHealth:
    """Looks at each frame before its spots are searched; remembers the last frame's sparse rows."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self._shape = shape
        self._capture_ns = -1
        self._rows = b""
        self._features = b""
        self._same_rows = False
        self._repeats = 0
        self._still = 0

    def look(self, image: Image | None, capture_ns: int) -> ImageReport:
        """Judge one frame, in order of arrival.

        Args:
            image: (h, w) uint8; None if its pixels could not be read.
            capture_ns: its stamp.
        """
        if image is None:
            return ImageReport(cause="no_frame")
        if image.shape != self._shape or image.dtype != np.uint8:
            return ImageReport(cause="bad_frame")
        if capture_ns <= self._capture_ns:
            return ImageReport(cause="stale_frame")
        self._capture_ns = capture_ns
        rows = image[8::64].tobytes()
        self._same_rows = rows == self._rows
        self._rows = rows
        level, white = background(image)
        exposure: StateCause | None = None
        if white > _WHITE_PART:
            exposure = "overexposed"
        elif level <= _DARKEST and not any(rows):
            exposure = "underexposed"
        return ImageReport(exposure=exposure, background=level)

    def frozen(self, features: Array, moving: bool) -> bool:
        """Whether the camera repeats itself.

        It does if pixels and features are the same in three frames, which no sensor does, or the very same features
        come in five while the robot moves.

        Args:
            features: (n, 2) of the frame that :meth:`look` judged last, NaN where not seen.
            moving: whether the robot moves.
        """
        before, self._features = self._features, features.tobytes()
        same = self._features == before and bool(np.isfinite(features).any())
        self._repeats = self._repeats + 1 if same and self._same_rows else 0
        self._still = self._still + 1 if same and moving else 0
        return self._repeats >= _FROZEN_FRAMES - 1 or self._still >= _STILL_FRAMES - 1


class ImageFollows:
    """Whether the image moves as the wheels do (``docs/safety.md`` S08, S40).

    What the measured speed must have done to the features since an earlier frame, eq. (10), the interaction matrix,
    is held against what they did. Turning is left out of what must be seen, as a drift can undo it; so is as much of
    the rest as a turn would look like. The camera's pitch and roll move all LEDs alike and cannot stop their
    spreading. So LEDs that almost stand while the wheels drive mean a camera that repeats itself, or slipping wheels.

    Args:
        height_difference_m: (n,) Δh = Z_C − Z_P per LED.
        camera_xyz_m: ξ in {F} [m].
        sigma: standard deviation of one normalised coordinate.
    """

    def __init__(self, height_difference_m: Array, camera_xyz_m: Array, sigma: float) -> None:
        self._height, self._mount = height_difference_m, camera_xyz_m
        self._least = _LEAST_SIGMAS * sigma
        self._at = np.full((len(height_difference_m), 2), np.nan)
        self._path = np.zeros_like(self._at)
        self._driven_m = 0.0
        self._capture_ns: int | None = None
        self._anchors: deque[tuple[int, Array, Array, float]] = deque()
        self._against = 0
        self._doubted = False
        self._stood_ns: int | None = None

    def doubted(self, features: Array, twist: tuple[float, float], capture_ns: int) -> bool:
        """Take one frame; true from when it did not follow until it does, or until the wheels have stood for 0.5 s.

        Args:
            features: (n, 2) normalised, NaN where not seen.
            twist: measured (v [m/s], ω [rad/s]) of {F} until the capture.
            capture_ns: of the frame.
        """
        flow = self._drive(features, twist, capture_ns)
        shares, along = self._shares(features, flow[:, :, 1])
        self._anchors.append((capture_ns, features, self._path.copy(), self._driven_m))
        while capture_ns - self._anchors[0][0] > _WINDOW_NS:
            self._anchors.popleft()
        self._against = self._against + 1 if len(shares) and shares.min() < _STANDS else 0
        stood = self._stood(twist, capture_ns)
        if self._against >= _CONFIRMED and not self._doubted:
            self._doubted = True
        elif self._doubted and (stood or (len(along) and _FOLLOWS[0] < along[-1] < _FOLLOWS[1])):
            self._doubted = False
        else:
            return self._doubted
        self._anchors.clear()
        self._against = 0
        return self._doubted

    def _drive(self, features: Array, twist: tuple[float, float], capture_ns: int) -> Array:
        """Carry on what the wheels make of the features; (n, 2, 2) their slopes by v and ω."""
        before_ns, self._capture_ns = self._capture_ns, capture_ns
        seconds = 0.0 if before_ns is None else (capture_ns - before_ns) / NS_PER_S
        if seconds > _GAP_S:
            self._anchors.clear()
        self._at = np.where(np.isfinite(features), features, self._at)
        flow = interaction_matrix(self._at, self._height, self._mount)
        self._path += np.nan_to_num(flow[:, :, 0]) * (twist[0] * seconds)
        self._driven_m += twist[0] * seconds
        return flow

    def _shares(self, features: Array, by_turn: Array) -> tuple[Array, Array]:
        """How much of the expected motion is seen since each frame that is far enough back, oldest first, (k,) each.

        Once by the length of what was seen, in whatever direction, which noise makes larger, never smaller; once
        along what was expected.
        """
        if not self._anchors:
            return np.zeros(0), np.zeros(0)
        _, before, paths, driven_m = zip(*self._anchors, strict=True)
        moved = features - np.array(before)
        both = np.isfinite(moved)
        moved = np.where(both, moved, 0.0)
        expected = np.where(both, self._path - np.array(paths), 0.0)
        turn = np.where(both, by_turn, 0.0)
        as_turn = _dot(expected, turn) / np.maximum(_dot(turn, turn), 1e-12)
        expected -= as_turn[:, None, None] * turn
        seen = both[:, :, 0].sum(axis=1)
        length = np.sqrt(_dot(expected, expected))
        enough = (length >= self._least * np.sqrt(np.maximum(seen, 1))) & (seen >= _FEWEST)
        enough &= np.abs(self._driven_m - np.array(driven_m)) >= _LEAST_M
        moved, expected, length = moved[enough], expected[enough], length[enough]
        return np.sqrt(_dot(moved, moved)) / length, _dot(moved, expected) / np.square(length)

    def _stood(self, twist: tuple[float, float], capture_ns: int) -> bool:
        if abs(twist[0]) > _STANDING or abs(twist[1]) > _STANDING:
            self._stood_ns = None
        elif self._stood_ns is None:
            self._stood_ns = capture_ns
        return self._stood_ns is not None and capture_ns - self._stood_ns >= _STOOD_NS


def _dot(a: Array, b: Array) -> Array:
    """Over the last two axes."""
    product: Array = np.einsum("...ij,...ij->...", a, b)
    return product
