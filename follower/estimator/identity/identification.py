"""Which spots are the LEDs: search without a prior, with a residual check and an ambiguity margin.

An ordered pair of spots taken for a pair of LEDs at a trial heading gives x and y in closed form from its two
bearings. The two heights then agree on one small camera pitch or the trial is dropped; the other LEDs are
predicted and the nearest spots gathered; every distinct assignment is fitted in full (x, y, θ, pitch, roll) and
judged by χ². A rival that fits nearly as well makes the answer "not sure".
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from common.geometry import Array, Pose2, wrap_angle
from follower.estimator.identity.mirror import MirrorCheck
from follower.estimator.identity.trials import FARTHEST_M, MASS_RATIO, MAX_PITCH, NEAREST_M, Indices, Trials
from follower.estimator.planar_fit import FitModel, fit

Failure = Literal["few_spots", "no_match", "ambiguous"]
Agrees = Callable[[Array, Array], NDArray[np.bool_]]

_WIDEST_BEAM_RAD = math.radians(75.0)
_ALIKE = 3.0


@dataclass(frozen=True)
class Limits:
    """When an assignment is accepted.

    ``chi2_full``/``chi2_partial`` bound χ² with every LED seen and with one missing; a rival within
    ``margin`` of the best χ² (or below its bound) makes the match ambiguous. With one LED missing, three spots
    among more than ``most_for_partial`` prove nothing, neither do three beside a fourth of like brightness, nor
    three that a mirror image explains as well.
    Above ``most_for_loose`` spots ``chi2_full`` falls with their number squared: so many chances has coincidence.
    """

    chi2_full: float = 15.0
    chi2_partial: float = 8.0
    margin: float = 30.0
    most_for_partial: int = 8
    most_for_loose: int = 10


@dataclass(frozen=True)
class Match:
    """An accepted assignment: the spot of each LED (−1: not seen), its state (x, y, θ, pitch, roll) and χ²."""

    spot_of_led: tuple[int, ...]
    state: Array
    chi2: float

    @property
    def pose(self) -> Pose2:
        """Pose of {L} in {F}."""
        return Pose2(float(self.state[0]), float(self.state[1]), wrap_angle(float(self.state[2])))


class Identifier:
    """Searches for one array; holds what depends on the array only."""

    def __init__(self, model: FitModel, limits: Limits) -> None:
        self._model = model
        self._limits = limits
        self._mirror = MirrorCheck(model)
        self._trials = Trials(model)
        self._height = model.camera_xyz_m[2] - model.points_l[:, 2]

    def identify(
        self, features: Array, mass: Array, allow_partial: bool, agrees: Agrees | None = None
    ) -> Match | Failure:
        """Find the array among N candidate spots.

        Args:
            features: (N, 2) normalised coordinates of the candidates.
            mass: (N,) brightness of the candidates; LEDs of one array are of a like brightness.
            allow_partial: also accept all LEDs but one, if nothing else explains the image.
            agrees: which fits, states (K, 5) with covariance (K, 5, 5), may be the array at all; where only others
                are found, the answer is ``ambiguous``. None: it may be anywhere.
        """
        leds = len(self._height)
        possible = self._possible(features)
        if len(possible) < leds - int(allow_partial):
            return "few_spots"
        found = self._search(features[possible], mass[possible], allow_partial, agrees)
        if not isinstance(found, Match):
            return found
        spots = tuple(int(possible[spot]) if spot >= 0 else -1 for spot in found.spot_of_led)
        return replace(found, spot_of_led=spots)

    def identify_all(self, features: Array, mass: Array, allow_partial: bool) -> list[Match] | Failure:
        """Every array among N candidate spots that no other explanation of the same spots rivals.

        Which of them is the right one is for the caller to find out.

        Args:
            features: (N, 2) normalised coordinates of the candidates.
            mass: (N,) brightness of the candidates.
            allow_partial: if there is none, also accept all LEDs but one of the only one in view.
        """
        possible = self._possible(features)
        leds = len(self._height)
        if len(possible) < leds:
            return self._as_list(self.identify(features, mass, allow_partial))
        assignments, starts = self._trials.of(features[possible], mass[possible])
        full = np.flatnonzero((assignments >= 0).all(axis=1))
        matches = self._apart(features[possible], assignments[full], starts[full]) if len(full) else []
        if not matches:
            return self._as_list(self.identify(features, mass, allow_partial))
        return [
            replace(each, spot_of_led=tuple(int(possible[spot]) for spot in each.spot_of_led)) for each in matches
        ]

    def _as_list(self, found: Match | Failure) -> list[Match] | Failure:
        return [found] if isinstance(found, Match) else found

    def _apart(self, features: Array, assignments: Indices, starts: Array) -> list[Match]:
        """Fits of all LEDs that share no spot with another that is nearly as good, the best first."""
        fits = fit(self._model, features[assignments], starts)
        chi2 = np.where(self._plausible(fits.states) & fits.in_front, fits.chi2, np.inf)
        bound = self._limits.chi2_full * min(1.0, self._limits.most_for_loose / len(features)) ** 2
        order = np.argsort(chi2)
        matches: list[Match] = []
        taken: set[int] = set()
        for place, row in enumerate(order):
            if not chi2[row] <= bound:
                break
            spots = set(assignments[row].tolist())
            if spots & taken:
                continue
            taken |= spots
            margin = max(bound, chi2[row] + self._limits.margin)
            rivals = [other for other in order[place + 1 :] if chi2[other] <= margin]
            if not any(spots & set(assignments[other].tolist()) for other in rivals):
                matches.append(Match(tuple(assignments[row].tolist()), fits.states[row], float(chi2[row])))
        return matches

    def _search(self, features: Array, mass: Array, allow_partial: bool, agrees: Agrees | None) -> Match | Failure:
        allow_partial = allow_partial and len(features) <= self._limits.most_for_partial
        assignments, starts = self._trials.of(features, mass)
        if not len(assignments):
            return "no_match"
        missing = (assignments < 0).sum(axis=1)
        full = self._limits.chi2_full * min(1.0, self._limits.most_for_loose / len(features)) ** 2
        if allow_partial:
            assignments, starts, missing = _with_one_left_out(assignments, starts, missing)
        for absent, bound in ((0, full), (1, self._limits.chi2_partial)):
            rows = np.flatnonzero(missing == absent)
            if absent and not allow_partial:
                break
            verdict = self._judge(features, assignments[rows], starts[rows], bound, agrees)
            if isinstance(verdict, Match) and absent and _another_nearby(verdict, features, mass):
                return "ambiguous"
            if isinstance(verdict, Match) and absent and agrees is None and self._may_be_mirrored(verdict, features):
                return "ambiguous"
            if isinstance(verdict, Match) and not absent and agrees is None:
                return "ambiguous" if self._second_array(verdict, features, mass) else verdict
            if verdict != "no_match":
                return verdict
        if agrees is not None:
            return "no_match" if self._search(features, mass, allow_partial, None) == "no_match" else "ambiguous"
        return "no_match"

    def _second_array(self, match: Match, features: Array, mass: Array) -> bool:
        """Whether what the match leaves unexplained holds another array of like brightness, one LED hidden perhaps.

        Among more than a few spots some three always fit, which proves nothing.
        """
        others = np.setdiff1d(np.arange(len(features)), match.spot_of_led)
        ratio = mass[others] / np.median(mass[list(match.spot_of_led)])
        others = others[np.abs(np.log(ratio)) <= np.log(MASS_RATIO)]
        if not len(self._height) - 1 <= len(others) <= self._limits.most_for_partial:
            return False
        assignments, starts = self._trials.of(features[others], mass[others])
        if not len(assignments):
            return False
        partial = (assignments < 0).sum(axis=1) == 1
        verdict = self._judge(
            features[others], assignments[partial], starts[partial], self._limits.chi2_partial, None
        )
        return verdict != "no_match"

    def _may_be_mirrored(self, match: Match, features: Array) -> bool:
        used = [spot for spot in match.spot_of_led if spot >= 0]
        return self._mirror.chi2(features[used], match.state) <= self._limits.chi2_partial

    def _possible(self, features: Array) -> Indices:
        """Candidates as high in the image as a LED can be."""
        ends = np.stack([self._height / NEAREST_M, self._height / FARTHEST_M])
        beta = features[:, 1]
        return np.flatnonzero((beta >= ends.min() - MAX_PITCH) & (beta <= ends.max() + MAX_PITCH))

    def _judge(
        self, features: Array, assignments: Indices, starts: Array, bound: float, agrees: Agrees | None
    ) -> Match | Failure:
        if not len(assignments):
            return "no_match"
        chosen = np.where((assignments >= 0)[:, :, None], features[assignments], np.nan)
        fits = fit(self._model, chosen, starts)
        possible = self._plausible(fits.states) & fits.in_front
        if agrees is not None:
            possible &= agrees(fits.states, fits.covariance)
        chi2 = np.where(possible, fits.chi2, np.inf)
        order = np.argsort(chi2)
        best = int(order[0])
        if not chi2[best] <= bound:
            return "no_match"
        if len(order) > 1 and chi2[order[1]] <= max(bound, chi2[best] + self._limits.margin):
            return "ambiguous"
        return Match(tuple(int(i) for i in assignments[best]), fits.states[best], float(chi2[best]))

    def _plausible(self, states: Array) -> NDArray[np.bool_]:
        """The LEDs face the camera, at a distance at which they can be seen."""
        x, y, theta = states[:, 0], states[:, 1], states[:, 2]
        bearing = np.arctan2(y, x) - theta
        facing = np.abs(np.arctan2(np.sin(bearing), np.cos(bearing))) <= _WIDEST_BEAM_RAD
        plausible: NDArray[np.bool_] = facing & (np.hypot(x, y) <= FARTHEST_M + 1.0)
        return plausible


def _another_nearby(match: Match, features: Array, mass: Array) -> bool:
    """Whether a spot of like brightness that the match leaves unexplained lies within the array's own size of it."""
    used = [spot for spot in match.spot_of_led if spot >= 0]
    centre = features[used].mean(axis=0)
    reach = 3.0 * np.hypot(*(features[used] - centre).T).max()
    others = np.setdiff1d(np.arange(len(features)), used)
    near = np.hypot(*(features[others] - centre).T) <= reach
    alike = np.abs(np.log(mass[others] / np.median(mass[used]))) <= np.log(_ALIKE)
    return bool((near & alike).any())


def _with_one_left_out(assignments: Indices, starts: Array, missing: Indices) -> tuple[Indices, Array, Indices]:
    """Add every assignment with each of its LEDs left out: one of its spots may be something else."""
    full = np.flatnonzero(missing == 0)
    leds = assignments.shape[1]
    reduced = np.repeat(assignments[full], leds, axis=0)
    reduced[np.arange(len(reduced)), np.tile(np.arange(leds), len(full))] = -1
    every = np.vstack([assignments, reduced])
    _, rows = np.unique(every, axis=0, return_index=True)
    all_starts = np.vstack([starts, np.repeat(starts[full], leds, axis=0)])
    kept = every[rows]
    return kept, all_starts[rows], (kept < 0).sum(axis=1)
