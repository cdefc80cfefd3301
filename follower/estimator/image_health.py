"""Is there an image at all: size, type, order in time, exposure, and a camera that repeats itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from common.frames.ring import Image
from common.geometry import Array
from common.messages import StateCause
from follower.estimator.spots import background

_WHITE_PART = 0.05
_DARKEST = 0.5
_FROZEN_FRAMES = 3
_STILL_FRAMES = 5


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
