"""When a process that another launcher started counts as gone."""

from __future__ import annotations

from common.timing import NS_PER_S, SteppedClock
from station.simulate.children import Absence


class PlayedBus:
    """Reports which processes are alive."""

    def __init__(self) -> None:
        self.names: set[str] = set()
        self.asked = 0

    def alive(self) -> set[str]:
        self.asked += 1
        return set(self.names)


def test_only_a_near_process_that_was_seen_before_counts_as_gone() -> None:
    bus, clock = PlayedBus(), SteppedClock()
    absence = Absence(bus.alive, {"follower-camera", "world"}, clock)

    def after_a_second() -> str:
        clock.advance_to(clock.now_ns() + NS_PER_S)
        return absence()

    assert after_a_second() == ""
    bus.names = {"follower-camera", "leader"}
    assert after_a_second() == ""
    bus.names = {"follower-camera"}
    assert after_a_second() == ""
    bus.names = set()
    assert (after_a_second(), after_a_second()) == ("", "")
    bus.names = {"follower-camera"}
    assert after_a_second() == ""
    bus.names = set()
    assert (after_a_second(), after_a_second()) == ("", "")
    assert after_a_second() == "process follower-camera died (no longer alive)"


def test_the_bus_is_asked_once_a_second() -> None:
    bus, clock = PlayedBus(), SteppedClock()
    absence = Absence(bus.alive, {"world"}, clock)
    for _ in range(50):
        absence()
        clock.advance_to(clock.now_ns() + NS_PER_S // 10)
    assert bus.asked == 5
