"""How a pause of an approach ends, and what an approach that may not be tried again is named by."""

from __future__ import annotations

from dataclasses import replace

from common.config import Config
from common.geometry import Pose2
from follower.supervisor.image_trust import NOT_FOLLOWING
from tests.rigs.supervisor_rig import ARMS, Bench, docking_state


def cause(bench: Bench) -> str:
    assert bench.mission is not None
    return bench.mission.cause


def test_a_pause_whose_reason_is_over_waits_for_health(bench: Bench) -> None:
    bench.to_approach()
    bench.step(controller_alive=False)
    mission = bench.step(controller_alive=True).mission
    assert (mission.motion, mission.waiting) == ("hold", "health")


def test_near_the_queue_no_search_begins_at_all(bench: Bench, config: Config) -> None:
    bench.to_approach()
    near = Pose2(config.docking.goal(1).x_m + 0.4, 0.0, 0.0)
    bench.step(**bench.there(near))
    bench.seen = replace(bench.seen, state=docking_state(config, near, valid=False))
    while bench.sequence.phase == "approach":
        bench.step()
    assert (bench.sequence.phase, cause(bench)) == ("aborted", "leds_lost: too close for a search")


def test_slip_that_lasts_ends_it(bench: Bench) -> None:
    bench.to_approach()
    state, drives = bench.seen.state, bench.seen.drives
    assert state is not None
    assert drives is not None
    slipping = replace(state, disturbance=(-0.6, 0.0, 0.0, 0.0))
    bench.run(5.0, state=slipping, drives=replace(drives, wheel_speed_rad_s=(2.0, 2.0)))
    assert (bench.sequence.phase, cause(bench)) == ("aborted", f"unwell: {NOT_FOLLOWING}")


def test_an_approach_of_more_than_a_minute_is_named(bench: Bench, config: Config) -> None:
    bench.to_approach()
    x_m = config.docking.goal(1).x_m + 3.0
    for _ in range(7):
        x_m -= 0.1
        bench.step(**bench.there(Pose2(x_m, 0.0, 0.0)))
        bench.run(10.0, arms=replace(ARMS, contact=True))
    assert bench.sequence.phase == "aborted"
    assert cause(bench) == "approach_timeout: no retry with something in contact or a lock engaged"
