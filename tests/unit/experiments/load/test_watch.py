"""Ages against their limits, in order of time."""

from __future__ import annotations

import pytest

from common.timing import NS_PER_MS, NS_PER_S
from experiments.load.watch import GAP, Ages


def test_what_gives_first_comes_first_and_only_once() -> None:
    ages = Ages(begin_ns=NS_PER_S)
    ages.note(GAP, 119 * NS_PER_MS, 2 * NS_PER_S)
    assert (ages.order, ages.last_over_ns) == ([], None)
    ages.gives("leader misses periods", 5 * NS_PER_S)
    ages.note("drives", 60 * NS_PER_MS, 3 * NS_PER_S)
    ages.note("drives", 51 * NS_PER_MS, 4 * NS_PER_S)
    assert ages.order == ["2.0 s drives older than 50 ms", "4.0 s leader misses periods"]
    assert ages.last_over_ns == 4 * NS_PER_S
    assert ages.worst_ns == {GAP: 119 * NS_PER_MS, "drives": 60 * NS_PER_MS}


def test_only_what_is_watched_has_a_limit() -> None:
    with pytest.raises(KeyError):
        Ages(begin_ns=0).note("weather", 1, 1)
