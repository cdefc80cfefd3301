"""How far the extended state observer can be off, for any gains that make it stable.

Eq. (26), the paper's bound κ + σ, takes the absolute value outside the integral of eq. (22). It holds where the
response to a disturbance keeps its sign, and fails where the observer rings: with L_1 = 0.4, L_2 = 1 and |h| ≤ 1 it
says 2.0, and the error reaches 3.3. Inside, the integral of the absolute response is what a disturbance that changes
sign with it reaches: no smaller number bounds the error for every h.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from common.geometry import Array

_FIRST = 4.0  # of one over the norm of A: the length of the first interval; each later one is twice as long
_FEWEST, _MOST = 256, 32_768  # steps of an interval
_LOOSE = 0.005  # share of the integral that the steps may add to it, if so few do
_SETTLED = 0.02  # norm of e^{At} at which what is left is bounded as a whole
_TERMS = 12


@dataclass(frozen=True)
class ErrorBound:
    """|ε_i(t)| ≤ μ ε_a(0) + γ reach_i, at all times, for every h with |h_j(t)| ≤ γ.

    Attributes:
        mu: of eq. (24), the largest entry of e^{At} ever.
        reach: (2m,) ∫ Σ_j |e^{Aτ} D|_ij dτ: of the m states, then of their disturbances.
    """

    mu: float
    reach: Array

    def at(self, initial_error: float, rate: float) -> Array:
        """(2m,) bounds of the errors.

        Args:
            initial_error: ε_a(0), the sum of |ε_j(0)|.
            rate: γ, the largest rate at which any disturbance changes.
        """
        bounds: Array = self.mu * initial_error + rate * self.reach
        return bounds


def error_bound(l1: Array | float, l2: Array | float) -> ErrorBound:
    """The bound of the error dynamics of eq. (20), from above: no step of the integration can make it too small.

    Args:
        l1: L_1, (m, m), or a number for one state.
        l2: L_2, like it.

    Raises:
        ValueError: A is not Hurwitz: the error grows without bound.
    """
    first, second = np.atleast_2d(np.asarray(l1, float)), np.atleast_2d(np.asarray(l2, float))
    size = len(first)
    system = np.block([[-first, np.eye(size)], [-second, np.zeros((size, size))]])
    if not np.isfinite(system).all() or np.linalg.eigvals(system).real.max() >= 0.0:
        raise ValueError("A of eq. (21) is not Hurwitz: with these gains the observer's error has no bound")
    growth, length_s = _growth(system), _FIRST / _norm(system)
    across = np.linalg.matrix_power(_exponential(system * length_s / _FEWEST), _FEWEST)
    mu, reach = _interval(system, np.eye(2 * size), length_s, growth, np.zeros(2 * size))
    while True:  # e^{At} tends to zero, and the time doubles
        if _norm(across) <= _SETTLED:  # the rest, r = |e^{AT}| (reach + r), entry by entry
            return ErrorBound(mu, np.linalg.solve(np.eye(2 * size) - np.abs(across), reach))
        largest, part = _interval(system, across, length_s, growth, reach)
        mu, reach = max(mu, largest), reach + part
        across, length_s = across @ across, 2.0 * length_s


def _interval(system: Array, begin: Array, length_s: float, growth: float, before: Array) -> tuple[float, Array]:
    """Bounds over one interval: of the largest entry of e^{At}, and (2m,) of the integral.

    Trapezoids, and the most by which a curve can lie above them: by its curvature, or where it may change its sign,
    by its slope. Steps are halved until that hardly counts.

    Args:
        system: A, (2m, 2m).
        begin: (2m, 2m) e^{At} at the begin.
        length_s: of the interval.
        growth: the largest norm of e^{At} ever.
        before: (2m,) the integral up to here.
    """
    half, steps = len(system) // 2, _FEWEST
    while True:
        step_s = length_s / steps
        curve = _along(system, begin, step_s, steps)
        slopes = np.abs(system @ curve[:-1])
        bends = growth * np.linalg.norm(system @ system @ curve[:-1], axis=1, keepdims=True)
        steepest = slopes + step_s * bends
        size = np.abs(curve)
        trapezoids = 0.5 * step_s * (size[:-1] + size[1:])
        may_cross = np.minimum(size[:-1], size[1:]) <= step_s * steepest
        above = np.where(may_cross, 0.25 * step_s**2 * steepest, step_s**3 / 12.0 * bends)
        part, added = (values[:, :, half:].sum(axis=(0, 2)) for values in (trapezoids, above))
        if np.all(added <= _LOOSE * (before + part)) or steps >= _MOST:
            largest = float((size[:-1] + step_s * steepest).max())
            return largest, part + added
        steps *= 2


def _along(system: Array, begin: Array, step_s: float, steps: int) -> Array:
    """(steps + 1, 2m, 2m): e^{At} from ``begin`` on; ``steps`` is a power of two."""
    halvings = max(0, math.ceil(math.log2(max(_norm(system) * step_s, 1e-300) / 0.05)))
    move = np.linalg.matrix_power(_exponential(system * step_s / 2**halvings), 2**halvings)
    curve = begin[None]
    for _ in range(steps.bit_length() - 1):
        curve = np.concatenate([curve, curve @ move])
        move = move @ move
    return np.concatenate([curve, (begin @ move)[None]])


def _growth(system: Array) -> float:
    """A number that the spectral norm of e^{At} never exceeds: from P of the Lyapunov equation AᵀP + PA = −I."""
    size = len(system)
    unit = np.eye(size)
    left = np.kron(system.T, unit) + np.kron(unit, system.T)
    lyapunov = np.linalg.solve(left, -unit.reshape(-1)).reshape(size, size)
    values = np.linalg.eigvalsh(0.5 * (lyapunov + lyapunov.T))
    return math.sqrt(values[-1] / max(values[0], 1e-300))


def _norm(matrix: Array) -> float:
    """Largest row sum."""
    return float(np.abs(matrix).sum(axis=1).max())


def _exponential(small: Array) -> Array:
    """Of a matrix whose norm is far below one, by its series."""
    total = term = np.eye(len(small))
    for k in range(1, _TERMS):
        term = term @ small / k
        total = total + term
    return total
