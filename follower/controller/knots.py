"""Inputs linear between knots: fewer variables, and bounds that hold between them as well."""

from __future__ import annotations

import numpy as np

from common.geometry import Array


class KnotBasis:
    """``u = basis @ z``: (N,) inputs from (m,) values at the knots."""

    def __init__(self, knots: tuple[int, ...]) -> None:
        self.knots = np.array(knots)
        steps = np.arange(self.knots[-1] + 1)
        self.basis = _interpolation(self.knots, steps)
        self.shift = _interpolation(self.knots, np.minimum(self.knots + 1, self.knots[-1]))
        self.lengths = np.diff(self.knots)

    def differences(self) -> Array:
        """(N, m): u_k − u_{k−1} from the knots, but for the u_{−1} of the first row."""
        rows = self.basis.copy()
        rows[1:] -= self.basis[:-1]
        return rows

    def rates(self) -> Array:
        """(m − 1, m): what u changes from knot to knot; to be held below the rate limit times ``lengths``."""
        return np.diff(np.eye(self.knots.size), axis=0)

    def hessian(self, effort: tuple[float, float], rate: tuple[float, float]) -> Array:
        """Of the cost of two inputs' squares and of their changes' squares, in the knots of both, (2m, 2m)."""
        differences = self.differences()
        blocks = [
            2 * (r * self.basis.T @ self.basis + s * differences.T @ differences)
            for r, s in zip(effort, rate, strict=True)
        ]
        nothing = np.zeros_like(blocks[0])
        return np.block([[blocks[0], nothing], [nothing, blocks[1]]])

    def braking(self, last: tuple[float, float], steps: tuple[float, float]) -> Array:
        """Two inputs brought from their ``last`` values to zero by at most ``steps`` a period, in the knots, (2m)."""
        periods = self.knots + 1
        slowed = [np.sign(u) * np.maximum(0.0, abs(u) - d * periods) for u, d in zip(last, steps, strict=True)]
        return np.concatenate(slowed)


def _interpolation(knots: Array, at: Array) -> Array:
    columns = [np.interp(at, knots, unit) for unit in np.eye(knots.size)]
    return np.stack(columns, axis=1)
