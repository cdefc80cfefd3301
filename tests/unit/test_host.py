"""A test is given up for the host's sake only where the host stood still in every try."""

from __future__ import annotations

from typing import cast

import pytest

from tests.host import STALL_MS, HostWatch, cannot_judge


class Played:
    """A watch that has seen what it is told."""

    def __init__(self, worst_ms: float) -> None:
        self._worst_ms = worst_ms

    def worst_ms(self) -> float:
        return self._worst_ms

    def stood_still(self) -> bool:
        return self._worst_ms > STALL_MS


def watches(*worst_ms: float) -> list[HostWatch]:
    return [cast(HostWatch, Played(each)) for each in worst_ms]


def test_one_try_without_a_stall_is_judged() -> None:
    cannot_judge(watches(50.0, STALL_MS, 60.0))


def test_stalls_in_every_try_skip_by_name() -> None:
    with pytest.raises(pytest.skip.Exception, match=r"in each of 2 tries, for up to 60 ms"):
        cannot_judge(watches(50.0, 60.0))
