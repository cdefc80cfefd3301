"""What may disturb the motion: hypotheses beside each other, each a Kalman filter of its own, and their weights.

A disturbance comes, changes and goes at once, at unknown moments: a jump process. Its best filter weighs
every history of such moments by how well it explains the images; here the likeliest few are kept. A history is its
present *kind*, which of the four disturbances are free to be other than zero, and what it has learned since.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.config import DisturbanceConfig
from common.geometry import Array, wrap_angle
from follower.model.motion import DISTURBANCE, POSE, STATES

Kinds = NDArray[np.bool_]

QUIET = (False, False, False, False)
SLIP = (True, True, False, False)
YAW = (False, False, True, False)
SIDEWAYS = (False, False, False, True)
ALL = (True, True, True, True)
BEGINNING = (SLIP, YAW, SIDEWAYS, ALL)

ONSETS_PER_S = 0.1  # of any kind, while driving
ENDS_PER_S = 0.3
DISTURBED_AT_FIRST = 0.2  # probability that something disturbs already when the observer begins
KEPT = 8  # histories that survive by their weight alone
PROTECTED = 3  # newest generations, which noise may not remove before the images can decide
NEGLIGIBLE = 1e-4  # weight of a history that is dropped


@dataclass
class Hypotheses:
    """k histories.

    Attributes:
        states: (k, 7).
        covariances: (k, 7, 7).
        log_weights: (k,), the largest near zero.
        kinds: (k, 4) which disturbances are free.
        generations: (k,) by which call of :meth:`Branching.branch` each was made.
    """

    states: Array
    covariances: Array
    log_weights: Array
    kinds: Kinds
    generations: NDArray[np.int64]

    @property
    def weights(self) -> Array:
        """(k,) probabilities."""
        shares: Array = np.exp(self.log_weights - self.log_weights.max())
        total: float = shares.sum()
        return shares / total

    @property
    def likeliest(self) -> int:
        """Index of the one with the largest weight."""
        return int(np.argmax(self.log_weights))

    def mean(self) -> Array:
        """Expected state (7,)."""
        best = self.states[self.likeliest]
        apart = self.states - best
        apart[:, 2] = np.remainder(apart[:, 2] + np.pi, 2 * np.pi) - np.pi
        mean: Array = best + self.weights @ apart
        mean[2] = wrap_angle(float(mean[2]))
        return mean

    def pose_covariance(self) -> Array:
        """(3, 3), with the spread between the histories."""
        apart = self.states[:, POSE] - self.mean()[POSE]
        apart[:, 2] = np.remainder(apart[:, 2] + np.pi, 2 * np.pi) - np.pi
        weights = self.weights
        within = np.tensordot(weights, self.covariances[:, POSE, POSE], 1)
        between: Array = within + (weights[:, None] * apart).T @ apart
        return between

    def take(self, chosen: NDArray[np.int64]) -> Hypotheses:
        """Only these histories.

        Args:
            chosen: (c,) their indices.
        """
        return Hypotheses(
            self.states[chosen],
            self.covariances[chosen],
            self.log_weights[chosen],
            self.kinds[chosen],
            self.generations[chosen],
        )


class Branching:
    """Makes histories: the first ones, and new branches of the likeliest."""

    def __init__(self, config: DisturbanceConfig) -> None:
        self._onset = np.square(config.onset_sigma)
        self._quiet = np.square(config.quiet_sigma)
        self._generation = 0

    def begin(self, pose: Array, covariance: Array) -> Hypotheses:
        """First histories: undisturbed, or disturbed already in an unknown way.

        Args:
            pose: (3,) x, y [m], θ [rad] of {L} in {F}.
            covariance: (3, 3) of the pose.
        """
        kinds = np.array([QUIET, *BEGINNING])
        count = len(kinds)
        covariances = np.zeros((count, STATES, STATES))
        covariances[:, POSE, POSE] = covariance
        variances = np.where(kinds, self._onset, self._quiet)
        covariances.reshape(count, -1)[:, 3 * (STATES + 1) :: STATES + 1] = variances
        log_weights = np.log([1.0 - DISTURBED_AT_FIRST, *[DISTURBED_AT_FIRST / (count - 1)] * (count - 1)])
        self._generation = 0
        states = np.tile(np.append(pose, np.zeros(4)), (count, 1))
        return Hypotheses(states, covariances, log_weights, kinds, np.zeros(count, dtype=np.int64))

    def branch(self, known: Hypotheses, by_disturbance: Array, since_s: float) -> Hypotheses:
        """The survivors and, of the likeliest, what it may have turned into during the last ``since_s``.

        Args:
            known: the histories.
            by_disturbance: (3, 4) how the pose moves with the disturbances, per second.
            since_s: since the last call; a change happened, on average, half of it ago.
        """
        self._generation += 1
        survivors = self.prune(known)
        parent = survivors.likeliest
        fewer = np.array([kind for kind in (QUIET, *BEGINNING) if _is_less(np.array(kind), survivors.kinds[parent])])
        children = [self._begun(survivors, parent, by_disturbance, since_s)]
        if len(fewer):
            children.append(self._ended(survivors, parent, fewer, by_disturbance, since_s))
        parts = [survivors, *children]
        return Hypotheses(*(np.concatenate([getattr(part, name) for part in parts]) for name in vars(survivors)))

    def prune(self, known: Hypotheses) -> Hypotheses:
        """Without those that hardly explain what is seen."""
        likely = known.log_weights - known.log_weights.max()
        rank = np.empty(len(likely), dtype=np.int64)
        rank[np.argsort(-likely)] = np.arange(len(likely))
        young = known.generations > self._generation - PROTECTED
        worth = young & (likely > 3 * np.log(NEGLIGIBLE)) | (rank < KEPT) & (likely > np.log(NEGLIGIBLE))
        kept = known.take(np.flatnonzero(worth))
        kept.log_weights -= kept.log_weights.max()
        return kept

    def _begun(self, known: Hypotheses, parent: int, by_disturbance: Array, since_s: float) -> Hypotheses:
        """The disturbances of each kind are drawn again, and have acted on the pose for half of the time already."""
        kinds = np.array(BEGINNING)
        acted = _acted(by_disturbance, since_s)
        covariances = known.covariances[parent] + (acted * (self._onset * kinds)[:, None, :]) @ acted.T
        log_weight = known.log_weights[parent] + np.log(ONSETS_PER_S * since_s / len(kinds))
        return self._children(known.states[parent], covariances, log_weight, known.kinds[parent] | kinds)

    def _ended(
        self, known: Hypotheses, parent: int, kinds: Kinds, by_disturbance: Array, since_s: float
    ) -> Hypotheses:
        """The disturbance ended halfway through the interval: undo its effect since. A simpler kind may remain."""
        state, covariance = known.states[parent], known.covariances[parent]
        back = -0.5 * since_s * by_disturbance @ state[DISTURBANCE]
        acted = _acted(by_disturbance, since_s)
        covariances = (acted * np.where(kinds, self._onset, self._quiet)[:, None, :]) @ acted.T
        covariances[:, POSE, POSE] += covariance[POSE, POSE] + np.outer(back, back) / 3.0
        log_weight = known.log_weights[parent] + np.log(ENDS_PER_S * since_s / len(kinds))
        return self._children(np.append(state[POSE] + back, np.zeros(4)), covariances, log_weight, kinds)

    def _children(self, state: Array, covariances: Array, log_weight: float, kinds: Kinds) -> Hypotheses:
        """One for each of (c, 4) kinds, all at one state and of one weight."""
        count = len(kinds)
        generations = np.full(count, self._generation)
        return Hypotheses(np.tile(state, (count, 1)), covariances, np.full(count, log_weight), kinds, generations)


def _acted(by_disturbance: Array, since_s: float) -> Array:
    """(7, 4) how a disturbance that has acted for half of the time shows in the state."""
    acted = np.zeros((STATES, 4))
    acted[POSE] = by_disturbance * (0.5 * since_s)
    acted[DISTURBANCE] = np.eye(4)
    return acted


def _is_less(kind: Kinds, than: Kinds) -> bool:
    return bool(np.all(kind <= than) and np.any(kind < than))
