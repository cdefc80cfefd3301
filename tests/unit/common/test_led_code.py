"""The codes are far apart at every shift, and one shift is another phase."""

from __future__ import annotations

import numpy as np
import pytest

from common.led_code import CODES, SYMBOLS, level, symbols_of

MOST_AGREEING = 19


def test_two_codes_or_a_code_and_its_shift_agree_in_few_symbols() -> None:
    codes = [symbols_of(number) for number in range(CODES)]
    for first in range(CODES):
        for second in range(first, CODES):
            shifts = range(1 if first == second else 0, SYMBOLS)
            most = max(int((codes[first] == np.roll(codes[second], shift)).sum()) for shift in shifts)
            assert most <= MOST_AGREEING, (first, second)


def test_the_level_goes_through_the_symbols_again_and_again() -> None:
    symbol_ns = 60_000_000
    period = [level(4, symbol_ns, 0.4, k * symbol_ns + symbol_ns // 2) for k in range(2 * SYMBOLS)]
    assert period[:SYMBOLS] == period[SYMBOLS:]
    assert period[:SYMBOLS] == [1.0 if symbol else pytest.approx(0.6) for symbol in symbols_of(4)]


@pytest.mark.parametrize("number", [-1, CODES])
def test_a_number_that_no_code_has_is_named(number: int) -> None:
    with pytest.raises(ValueError, match=f"no LED code {number}: there are 0 to 32"):
        symbols_of(number)
