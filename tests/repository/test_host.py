"""A test is repeated, and at last given up, for the host's sake only where the host was in its way each time."""

from __future__ import annotations

from typing import Any, cast

import pytest

from tests.rigs import host
from tests.rigs.host import HostWatch, Pace, judged_on_a_calm_host


class Played:
    """Watches that return the given readings, one after another."""

    def __init__(self, *seen: str) -> None:
        self._seen = list(seen)
        self.made = 0

    def __call__(self) -> HostWatch:
        self.made += 1
        return cast(HostWatch, self)

    def __enter__(self) -> Played:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def poor(self) -> str:
        return self._seen[self.made - 1]


@pytest.fixture(autouse=True)
def fresh_rule(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(host, "_CALM_S", 0.0)
    monkeypatch.setattr(host, "_given_up", [])


def failing(times: int) -> Any:
    left = [times]

    def attempt() -> None:
        left[0] -= 1
        assert left[0] < 0, "the wheels went on"

    return attempt


def test_a_failure_on_a_calm_host_stands_at_once() -> None:
    watch = Played("", "")
    with pytest.raises(AssertionError, match="the wheels went on"):
        judged_on_a_calm_host(failing(1), watch)
    assert watch.made == 1


def test_a_failure_on_a_calm_host_stands_after_one_in_a_stall() -> None:
    watch = Played("stood still for 50 ms", "")
    with pytest.raises(AssertionError, match="the wheels went on"):
        judged_on_a_calm_host(failing(2), watch)
    assert watch.made == 2


def test_a_failure_in_a_stall_is_repeated_until_it_passes() -> None:
    watch = Played("stood still for 50 ms", "")
    judged_on_a_calm_host(failing(1), watch)
    assert watch.made == 2


def test_stalls_in_every_try_skip_by_name_with_the_failure() -> None:
    watch = Played("stood still for 50 ms", "computed 2.4 times slower than usual")
    named = r"the host stood still for 50 ms; then computed 2\.4 times .*: .*the wheels went on"
    with pytest.raises(pytest.skip.Exception, match=named):
        judged_on_a_calm_host(failing(2), watch)


def test_after_two_tests_were_given_up_others_get_one_try() -> None:
    for tries in (2, 2, 1):
        watch = Played("stood still for 50 ms", "stood still for 50 ms")
        with pytest.raises(pytest.skip.Exception):
            judged_on_a_calm_host(failing(2), watch)
        assert watch.made == tries


def test_other_errors_are_never_the_hosts_fault() -> None:
    def broken() -> None:
        raise ValueError("no number")

    with pytest.raises(ValueError, match="no number"):
        judged_on_a_calm_host(broken, Played("stood still for 50 ms"))


def test_a_watch_says_what_it_saw(monkeypatch: pytest.MonkeyPatch) -> None:
    with HostWatch() as watch:
        monkeypatch.setattr(HostWatch, "worst_ms", lambda _: host.STALL_MS)
        monkeypatch.setattr(Pace, "slowness", lambda _: host.SLOWNESS)
        assert watch.poor() == ""
        monkeypatch.setattr(HostWatch, "worst_ms", lambda _: 33.0)
        monkeypatch.setattr(Pace, "slowness", lambda _: 2.5)
        assert watch.poor() == "stood still for 33 ms and computed 2.5 times slower than usual"
