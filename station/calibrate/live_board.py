"""``davpc calibrate camera --live``: views of the board collected until the image is covered."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from common.frames.ring import Image
from common.geometry import Array
from station.calibrate.board import Board, Size, covered_cells, find_corners, lacking

_MOVED_SHARE = 0.05  # of the image's width: nearer than that, a view adds nothing
_ENOUGH_VIEWS = 16


class BoardCollector:
    """Keeps a view of the board whenever it is found somewhere new."""

    def __init__(self, board: Board, size: Size) -> None:
        self._board = board
        self.size = size
        self.views: list[Array] = []
        self.found = False

    def take(self, image: Image) -> bool:
        """Look for the board in an image; true if its view is kept.

        Args:
            image: (height, width) grey, of ``size``.
        """
        corners = find_corners(image, self._board)
        self.found = corners is not None
        if corners is None:
            return False
        moved_px = min((float(np.hypot(*(corners - view).T).mean()) for view in self.views), default=np.inf)
        if moved_px < _MOVED_SHARE * self.size[0]:
            return False
        self.views.append(corners)
        return True

    @property
    def missing(self) -> str:
        """What is still to be shown; empty when it is enough."""
        text = lacking(self.views, self.size)
        if not text and len(self.views) < _ENOUGH_VIEWS:
            text = f"{len(self.views)} of {_ENOUGH_VIEWS} views: tilt the board and turn it"
        return text

    def grid(self) -> str:
        """The image's 6 × 6 cells as text: ■ where a corner was seen."""
        cells = covered_cells(self.views, self.size)
        return "\n".join(" ".join("■" if cell else "·" for cell in row) for row in cells)


def collect(images: Iterable[Image], collector: BoardCollector, show: Callable[[], None]) -> None:
    """Look at images until nothing is missing or they end; ``show`` is called after each."""
    for image in images:
        collector.take(image)
        show()
        if not collector.missing:
            return
