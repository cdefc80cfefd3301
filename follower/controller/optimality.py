"""Whether a solver's answer is the optimum that it claims to be: the Karush–Kuhn–Tucker conditions, evaluated again.

Nothing else detects a solver that reports success with a wrong answer that keeps its constraints: its own residuals
are its own claim.
"""

from __future__ import annotations

import numpy as np

from common.geometry import Array


def worst_complementarity(multipliers: Array, values: Array, low: Array, high: Array) -> float:
    """Largest product of a multiplier and the distance to the bound that it claims is met.

    Args:
        multipliers: (k,) positive at the upper bound, negative at the lower one.
        values: (k,) of what is bounded by ``low`` and ``high``. A value beyond its bound, a soft one, counts as
            met: feasibility is judged apart.
    """
    claimed = multipliers != 0.0
    distance = np.maximum(0.0, np.where(multipliers > 0.0, high - values, values - low)[claimed])
    return float(np.max(np.abs(multipliers[claimed]) * distance, initial=0.0))


def quadratic_residual(
    hessian: Array,
    gradient: Array,
    matrix: Array,
    bounds: tuple[Array, Array],
    solution: Array,
    multipliers: Array,
) -> float:
    """Worst KKT residual of min ½xᵀHx + fᵀx with bounds on [x, Ax], relative to 1 + the largest gradient.

    Args:
        hessian: H, (m, m).
        gradient: f, (m,).
        matrix: A, (r, m).
        bounds: lower and upper, (m + r,) each, of [x, Ax].
        solution: x, (m,).
        multipliers: (m + r,), positive at the upper bound.

    Returns:
        NaN or infinite where the answer is not a number.
    """
    slope = hessian @ solution + gradient + multipliers[: solution.size] + matrix.T @ multipliers[solution.size :]
    values = np.concatenate([solution, matrix @ solution])
    worst = np.maximum(np.abs(slope).max(), worst_complementarity(multipliers, values, *bounds))
    return float(worst / (1.0 + np.abs(gradient).max()))
