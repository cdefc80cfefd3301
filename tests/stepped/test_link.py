"""A docking whose link between the robots is cut in the approach, for good or for a while."""

from __future__ import annotations

from common.config import Config
from common.timing import NS_PER_S
from experiments.queues.run import Backstage, Docking, plan, run_plan

NEVER_NS = 1 << 62
START = [2.0, 0.05, 1.0]


def docking(config: Config, cut_s: float) -> Docking:
    """One docking whose link is cut half a second into the approach, for so long."""
    began_ns: list[int] = []

    def cut(now_ns: int, phase: str, stage: Backstage) -> None:
        if phase == "approach" and not began_ns:
            began_ns.append(now_ns + NS_PER_S // 2)
            stage.executor.cut_link(began_ns[0])
        elif began_ns and now_ns >= began_ns[0] + cut_s * NS_PER_S:
            stage.executor.cut_link(NEVER_NS)

    (ended,) = run_plan(plan(config, start=START, seed=3), cut)
    assert began_ns
    return ended


def test_without_the_link_the_approach_goes_on_and_the_lock_step_ends_by_name(config: Config) -> None:
    hasty = config.supervisor.model_copy(update={"link_timeout_s": 3.0})
    ended = docking(config.model_copy(update={"supervisor": hasty}), cut_s=1e6)
    assert (ended.phase, ended.cause) == ("aborted", "leader_silent")
    passed = [phase for phase, _ in ended.phases_s]
    assert "lock" in passed
    assert "release" not in passed


def test_a_link_that_returns_in_the_approach_costs_nothing(config: Config) -> None:
    ended = docking(config, cut_s=2.0)
    assert ended.done, ended
    assert [phase for phase, _ in ended.phases_s].count("approach") == 1
