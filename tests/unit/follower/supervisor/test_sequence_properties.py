"""The docking sequence under random events: no unsafe output, no dead end. ``make prove`` takes many more."""

from __future__ import annotations

import copy
import os
from dataclasses import replace

import pytest

from common.config import Config
from common.messages import DockRequest
from common.timing import NS_PER_S
from follower.supervisor.interface import SupervisorInputs
from follower.supervisor.transitions import ENDED, TABLE
from tests.rigs.docking_walk import STEP_NS, DockingWalk

EVENTS = int(os.environ.get("MACHINE_EVENTS", "100000"))
WALKS = 8


@pytest.mark.parametrize("seed", range(WALKS))
def test_the_supervisor_never_does_what_is_unsafe_and_never_gets_stuck(config: Config, seed: int) -> None:
    walk = DockingWalk(config, seed)
    for number in range(EVENTS // 5 // WALKS):
        walk.step()
        if number % 500 == 499:
            ends_by_itself(walk, silent=number % 1000 == 999)
    assert {"acquire", "approach", "aborted"} <= walk.phases


def ends_by_itself(walk: DockingWalk, silent: bool) -> None:
    """Left alone, with nothing heard or with the last observation for ever, it ends; the operator resets."""
    sequence = copy.deepcopy(walk.sequence)
    seen = replace(walk.seen, requests=(), lock_answers=(), restarted="", unfit="")
    if silent:
        seen = SupervisorInputs(
            now_ns=seen.now_ns, state=None, drives=None, arms=None, leader=None, controller_alive=False
        )
    for _ in range(20 * 900):
        seen = replace(seen, now_ns=seen.now_ns + STEP_NS)
        sequence.step(seen)
        if sequence.phase in ENDED:
            break
    assert sequence.phase in ENDED
    for action in ("reset", "start"):
        request = DockRequest(action, seen.now_ns + NS_PER_S, action)
        (answer,) = sequence.step(replace(seen, requests=(request,))).answers
        assert answer.outcome in ("done", "accepted"), answer
    assert sequence.phase not in ("idle", "done")


def test_walks_together_see_every_phase_and_most_ways(config: Config) -> None:
    taken: set[tuple[str, str]] = set()
    # a random walk does not stay at the goal for long
    hasty = config.model_copy(update={"docking": config.docking.model_copy(update={"settle_s": 0.5})})
    for seed in range(100, 100 + WALKS):
        walk = DockingWalk(hasty, seed)
        before: str = "idle"
        for _ in range(2000):
            walk.step()
            taken.add((before, walk.sequence.phase))
            before = walk.sequence.phase
    assert {phase for _, phase in taken} == {row.to for row in TABLE}
    # some phases pass within one step and are not seen one by one
    ways = {(row.phase, row.to) for row in TABLE}
    assert len(taken & ways) > len(ways) // 2
