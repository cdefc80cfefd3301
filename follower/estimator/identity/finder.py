"""Arrays anywhere in an image: spots, identification, fit, and whether they are as bright as ours."""

from __future__ import annotations

import numpy as np

from common.config import Config
from common.frames.ring import Image
from common.geometry import Array
from common.messages import StateCause
from follower.estimator.identity.brightness import LedBrightness, Verdict
from follower.estimator.identity.identification import Agrees, Failure, Identifier, Limits, Match
from follower.estimator.lens import Lens
from follower.estimator.planar_fit import FitModel
from follower.estimator.single_fit import fit_one
from follower.estimator.spots import NoisyImageError, SpotRule, Spots, brightest, find_spots
from follower.estimator.tracking import Followed

MOST_CANDIDATES = 40
_PARTIAL_AFTER = 12
_SAME_PX = 6.0

_CAUSES: dict[Failure, StateCause] = {
    "few_spots": "few_leds",
    "no_match": "not_identified",
    "ambiguous": "ambiguous",
}


class ArrayFinder:
    """Searches whole images; after some in which nothing was found, a LED may be hidden."""

    def __init__(self, config: Config, model: FitModel, lens: Lens) -> None:
        self._settings, self._model, self._lens = config.estimator, model, lens
        self._focal_px = config.camera.lens.fx_px
        self._identifier = Identifier(model, Limits())
        by_brightness = config.leds.brightness is not None and config.estimator.method == "davpc"
        self._brightness = LedBrightness(config.leds, config.camera) if by_brightness else None
        self._failures = 0

    def find(
        self, image: Image, rule: SpotRule, light: float, agrees: Agrees | None
    ) -> tuple[Followed | StateCause, int]:
        """The only array, or why there is none; and the number of spots.

        Args:
            image: (h, w) uint8.
            rule: what counts as a spot.
            light: the frame's exposure times gain over the configured ones.
            agrees: which fits may be the array, see :meth:`Identifier.identify`.

        Raises:
            NoisyImageError: too many spots.
        """
        spots = find_spots(image, rule)
        candidates = brightest(spots, MOST_CANDIDATES)
        match = self._identifier.identify(
            self._lens.to_normalised(candidates.pixels),
            candidates.mass,
            allow_partial=self._failures >= _PARTIAL_AFTER and self._settings.method == "davpc",
            agrees=agrees,
        )
        found = self.taken(candidates, list(match.spot_of_led), match.state) if isinstance(match, Match) else None
        if found is None:
            self._failures += 1
            return "residual" if isinstance(match, Match) else _CAUSES[match], len(spots)
        verdict = self._verdict(found, rule, light)
        if verdict != "like":
            self._failures += 1
            return "underexposed" if verdict == "dim" else "not_identified", len(spots)
        self._failures = 0
        return found, len(spots)

    def find_others(
        self, image: Image, rule: SpotRule, light: float, followed: list[Array]
    ) -> list[Followed] | StateCause:
        """All arrays in the image but those that are followed; or why there is none.

        Args:
            image: (h, w) uint8.
            rule: what counts as a spot.
            light: the frame's exposure times gain over the configured ones.
            followed: features (n, 2) of each of those.
        """
        spots = find_spots(image, rule)
        candidates = brightest(spots, MOST_CANDIDATES)
        features = self._lens.to_normalised(candidates.pixels)
        for known in followed:
            away = np.hypot(*(features[:, None, :] - known[None, :, :]).T)  # (n, N), NaN where a LED is hidden
            fresh = ~(away * self._focal_px < _SAME_PX).any(axis=0)
            candidates, features = candidates.take(np.flatnonzero(fresh).tolist()), features[fresh]
        partial = self._failures >= _PARTIAL_AFTER
        matches = self._identifier.identify_all(features, candidates.mass, allow_partial=partial)
        if isinstance(matches, str):
            self._failures += 1
            return _CAUSES[matches]
        found = [
            taken for match in matches if (taken := self.taken(candidates, list(match.spot_of_led), match.state))
        ]
        alike = [each for each in found if self._verdict(each, rule, light) == "like"]
        if not alike:
            self._failures += 1
            dim = any(self._verdict(each, rule, light) == "dim" for each in found)
            return "underexposed" if dim else "not_identified" if found else "residual"
        self._failures = 0
        return alike

    def shows(self, image: Image, rule: SpotRule) -> bool:
        """Whether all LEDs of an array are identified under another rule.

        Args:
            image: (h, w) uint8.
            rule: what counts as a spot.
        """
        try:
            spots = brightest(find_spots(image, rule), MOST_CANDIDATES)
        except NoisyImageError:
            return False
        match = self._identifier.identify(self._lens.to_normalised(spots.pixels), spots.mass, allow_partial=False)
        return isinstance(match, Match)

    def taken(self, spots: Spots, chosen: list[int], start: Array) -> Followed | None:
        """The chosen spots fitted; None if they are not the array.

        Args:
            spots: of the image.
            chosen: by LED, which of them it is; −1: none.
            start: (5,) state x, y [m], θ, pitch, roll [rad] to begin the fit at.
        """
        used = np.array(chosen) >= 0
        features = np.where(used[:, None], self._lens.to_normalised(spots.pixels)[chosen], np.nan)
        fitted = fit_one(self._model, features, start)
        if fitted is None or fitted.residual_rms * self._focal_px > self._settings.identification_residual_px:
            return None
        mass = np.where(used, spots.mass[chosen], np.nan)
        return Followed(features, fitted, mass, mass, len(spots))

    def _verdict(self, found: Followed, rule: SpotRule, light: float) -> Verdict:
        """Whether an array is as bright as ours; where that is not configured, it is."""
        if self._brightness is None:
            return "like"
        return self._brightness.judge(found.fitted.state, found.seen_mass, rule.threshold, light)
