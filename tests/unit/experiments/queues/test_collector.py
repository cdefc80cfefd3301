"""Who asks for one docking after the other."""

from __future__ import annotations

from dataclasses import replace

from common.config import Config
from common.messages import Answer, DockRequest, LockRequest, Mission, Phase
from common.timing import NS_PER_S
from experiments.contact.handle_bench import resting_mission
from experiments.queues.collector import Collector


def mission(config: Config, trolley: int, phase: Phase) -> Mission:
    return replace(resting_mission(config), trolley=trolley, phase=phase)


def accepted(collector: Collector, request: DockRequest | LockRequest | None, outcome: str = "accepted") -> None:
    assert request is not None
    collector.answered(Answer(request.id, outcome, "as a test says"))  # type: ignore[arg-type]


def test_each_docking_is_asked_once_the_one_before_is_done(config: Config) -> None:
    collector, now = Collector(1, 2, 0), NS_PER_S
    first = collector.step(now)
    assert isinstance(first, DockRequest)
    assert first.trolley == 1
    accepted(collector, first)
    for phase in ("staging", "approach", "push", "retract"):
        collector.take(mission(config, 1, phase))
        assert collector.step(now) is None
    collector.take(mission(config, 1, "done"))
    assert collector.step(now) is None
    second = collector.step(now + NS_PER_S)
    assert isinstance(second, DockRequest)
    assert second.trolley == 2
    accepted(collector, second)
    collector.take(mission(config, 1, "done"))  # still the old one's
    assert not collector.finished
    collector.take(mission(config, 2, "done"))
    assert collector.finished
    assert collector.refused == ""


def test_an_abort_ends_the_collection(config: Config) -> None:
    collector = Collector(1, 8, 0)
    accepted(collector, collector.step(1))
    collector.take(mission(config, 1, "aborted"))
    assert collector.finished
    assert collector.step(10 * NS_PER_S) is None


def test_a_request_is_repeated_under_its_id_and_then_given_up() -> None:
    collector = Collector(1, 1, 0)
    asked = [collector.step(second * NS_PER_S) for second in range(1, 8)]
    ids = {request.id for request in asked if request is not None}
    assert len(ids) == 1
    assert collector.finished
    assert "does not answer" in collector.refused


def test_a_refusal_is_the_cause() -> None:
    collector = Collector(1, 1, 0)
    accepted(collector, collector.step(1), "refused")
    assert collector.finished
    assert "as a test says" in collector.refused


def test_the_leader_receives_the_count_before_a_later_trolley() -> None:
    collector = Collector(5, 1, 0)
    count = collector.step(1)
    assert isinstance(count, LockRequest)
    assert (count.action, count.trolley, count.confirmed) == ("count", 4, True)
    accepted(collector, count, "done")
    dock = collector.step(2)
    assert isinstance(dock, DockRequest)
    assert dock.trolley == 5
