"""Whether an image that did not follow the wheels may be believed again (``docs/safety.md`` S08, S40). Pure."""

from __future__ import annotations

from typing import Final

import numpy as np

from common.config import Config
from common.geometry import Array, interaction_matrix
from common.messages import DockingState

NOT_FOLLOWING: Final = "the image does not follow the wheels: frozen camera or slipping wheels"
# what has to be turned: the LEDs move by ten pixels; beyond which, play of the gears included, the image stands
_ENOUGH_RAD, _STANDS_RAD = 0.012, 0.03
_FOLLOWS, _FEWEST = 0.4, 2


class ImageTrust:
    """An image is doubted from when it did not follow the wheels until it follows a turn on the spot.

    A noisy image that stands still and wheels that slip look the same, also once the robot stands. A turn cannot move
    the robot ahead, and shows whether the image lives. ``doubted``: not yet; ``stands``: it did not follow the turn.
    """

    def __init__(self, config: Config) -> None:
        self._mount = config.camera.mount
        self._height = self._mount[2] - config.leds.points[:, 2]
        self._from: tuple[float, Array] | None = None
        self.doubted = self.stands = False

    def step(self, state: DockingState | None, heading_rad: float) -> None:
        """Take one step.

        Args:
            state: the newest docking state; None: missing or too old.
            heading_rad: of {F} by the wheels, from an arbitrary zero.
        """
        if state is not None and state.cause == "not_following":
            self.doubted, self.stands, self._from = True, False, None
        if not self.doubted or state is None or not state.valid or len(state.features) != len(self._height):
            return
        features = np.array([(np.nan, np.nan) if each is None else each for each in state.features], dtype=float)
        if self._from is None:
            enough = np.isfinite(features).all(axis=1).sum() >= _FEWEST
            self._from = (heading_rad, features) if enough else None
            return
        turned_rad = heading_rad - self._from[0]
        if abs(turned_rad) < _ENOUGH_RAD:
            return
        expected = interaction_matrix(features, self._height, self._mount)[:, :, 1] * turned_rad
        moved = features - self._from[1]
        seen = np.isfinite(moved).all(axis=1)
        share = float((moved * expected)[seen].sum() / np.square(expected[seen]).sum()) if seen.any() else 0.0
        if share > _FOLLOWS and seen.sum() >= _FEWEST:
            self.doubted, self._from = False, None
        else:
            self.stands = abs(turned_rad) > _STANDS_RAD
