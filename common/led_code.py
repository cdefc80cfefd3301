"""The light code of a Leader: by which its own Follower tells its array from any other light (docs/led-code.md).

All LEDs of an array go between full and reduced current together, symbol by symbol, for ever. A pair's code is one
of the 33 Gold codes of length 31 (R. Gold, "Optimal binary sequences for spread spectrum multiplexing", IEEE
Transactions on Information Theory 13 (4), 1967): two of them, or one and a shift of itself, agree in at most 19 of 31
symbols.
"""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

SYMBOLS = 31
CODES = SYMBOLS + 2
_REGISTER = 5
# x⁵ + x² + 1 and x⁵ + x⁴ + x³ + x² + 1, a preferred pair: exponents of the recurrence a(k + 5) = Σ a(k + e)
_FIRST, _SECOND = (0, 2), (0, 2, 3, 4)


@functools.cache
def symbols_of(number: int) -> NDArray[np.bool_]:
    """Symbols of a code, (31,): True is full current.

    Args:
        number: of the code, from 0 to 32.

    Raises:
        ValueError: there is no such code.
    """
    if not 0 <= number < CODES:
        raise ValueError(f"no LED code {number}: there are 0 to {CODES - 1}")
    first, second = _sequence(_FIRST), _sequence(_SECOND)
    if number == SYMBOLS:
        return first
    if number == SYMBOLS + 1:
        return second
    return first ^ np.roll(second, -number)


def level(number: int, symbol_ns: int, depth: float, time_ns: int) -> float:
    """Share of the full current at a time: 1 or 1 − ``depth``.

    Args:
        number: of the code.
        symbol_ns: duration of a symbol.
        depth: of the modulation, 0 … 1.
        time_ns: of any clock; the phase of the code does not matter.
    """
    return 1.0 if symbols_of(number)[time_ns // symbol_ns % SYMBOLS] else 1.0 - depth


def _sequence(exponents: tuple[int, ...]) -> NDArray[np.bool_]:
    """One period of a maximum-length sequence."""
    bits = [True] * _REGISTER
    while len(bits) < SYMBOLS:
        k = len(bits) - _REGISTER
        bits.append(sum(bits[k + e] for e in exponents) % 2 == 1)
    return np.array(bits)
