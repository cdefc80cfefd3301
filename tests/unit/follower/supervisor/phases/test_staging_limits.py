"""Staging, step by step: how long each step may take, what it waits for, and what restarts it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from common.config import Config
from common.geometry import Pose2
from common.messages import ArmState
from common.timing import NS_PER_MS, NS_PER_S
from tests.rigs.supervisor_rig import ARMS, DRIVES, LEADER, Bench, docking_state

OPEN = ArmState(0.0, False, False, False, True)
CLOSED = ArmState(0.0, False, False, False, False)
LOCKED = replace(LEADER, lock="locked", queue=1)


def cause(bench: Bench) -> str:
    assert bench.mission is not None
    return bench.mission.cause


def waiting(bench: Bench) -> str:
    assert bench.mission is not None
    return bench.mission.waiting


def grip(bench: Bench) -> str:
    assert bench.mission is not None
    return bench.mission.grip


def ask(bench: Bench, back_m: float = 1.0, **changes: Any) -> None:
    """A docking of trolley 2 with empty grippers, so far before its staging pose."""
    docking = bench.config.docking
    x_m = docking.goal(2).x_m + docking.staging_distance_m - back_m
    state = docking_state(bench.config, Pose2(x_m, 0.0, 0.0))
    bench.run(0.3, state=state, leader=LOCKED, arms=CLOSED, **changes)
    assert bench.ask("start", trolley=2).outcome == "accepted"


def to_back(bench: Bench, back_m: float = 1.0) -> None:
    ask(bench, back_m)
    bench.run(0.2)
    bench.step(arms=OPEN)
    assert waiting(bench) == "staging pose"


def to_stand(bench: Bench) -> None:
    to_back(bench)
    bench.step()
    bench.step(drives=bench.roll(-0.99))
    assert bench.run(0.3) == "staging"
    assert waiting(bench) == "trolley"


def test_the_check_may_take_five_seconds(bench: Bench) -> None:
    ask(bench, controller_alive=False)
    assert bench.run(5.0) == "staging"
    assert waiting(bench) == "controller silent"
    assert bench.run(0.1) == "aborted"
    assert cause(bench) == "staging_timeout: controller silent"


def test_drives_that_do_not_follow_end_it(bench: Bench) -> None:
    ask(bench, drives=replace(DRIVES, state="enabling", cause="arm_setpoint_age"))
    bench.run(4.9)
    assert (bench.sequence.phase, waiting(bench)) == ("staging", "drives")
    bench.run(0.3)
    assert cause(bench) == "staging_timeout: drives not enabled (arm_setpoint_age)"


def test_grippers_that_do_not_open_end_it(bench: Bench) -> None:
    ask(bench)
    bench.run(6.0)
    assert (bench.sequence.phase, waiting(bench)) == ("staging", "grippers to open")
    bench.run(0.2)
    assert cause(bench) == "release_timeout"


def test_arms_that_are_silent_do_not_count_as_open(bench: Bench) -> None:
    ask(bench)
    bench.run(0.3, arms=None)
    assert waiting(bench) == "grippers to open"


def test_the_way_back_ends_two_centimetres_before_its_end(bench: Bench) -> None:
    to_back(bench)
    bench.step()
    assert bench.mission is not None
    assert (bench.mission.motion, bench.mission.waiting) == ("straight", "staging pose")
    assert bench.step(drives=bench.roll(-0.9797)).mission.motion == "straight"
    assert bench.step(drives=bench.roll(-0.9803)).mission.motion == "hold"
    assert bench.step().mission.waiting == "trolley"


def test_the_way_back_is_bounded_in_time(bench: Bench) -> None:
    """1.3 times what it takes at its speed, and two seconds."""
    to_back(bench)
    assert bench.run(14.95) == "staging"
    bench.seen = replace(bench.seen, now_ns=bench.seen.now_ns + 20 * NS_PER_MS)
    bench.step()
    assert cause(bench) == "staging_timeout: the path back was not completed"


def test_it_closes_after_it_has_stood_for_a_second(bench: Bench) -> None:
    to_stand(bench)
    for n in range(20):
        bench.step(drives=bench.roll(-0.99 - 0.005 * (n + 1)))
    assert bench.mission is not None
    assert (grip(bench), bench.mission.waiting) == ("open", "trolley")
    bench.run(1.0)
    assert grip(bench) == "open"
    bench.run(0.4)
    assert (grip(bench), bench.mission.waiting) == ("closed", "grip on the trolley")


def test_a_grip_is_believed_after_half_a_second_and_a_miss_opens_again(bench: Bench) -> None:
    to_stand(bench)
    bench.run(1.2)
    for _ in range(2):
        bench.run(0.3, arms=ARMS)
        assert (bench.sequence.phase, waiting(bench)) == ("staging", "grip on the trolley")
        bench.run(0.1, arms=CLOSED)
    bench.run(5.3)
    bench.step()
    assert bench.mission is not None
    assert grip(bench) == "open"
    bench.run(0.2, arms=OPEN)
    assert waiting(bench) == "trolley"
    bench.run(1.2)
    assert grip(bench) == "closed"
    assert bench.run(0.45, arms=ARMS) == "staging"
    assert bench.run(0.15) == "acquire"


def test_a_grip_that_comes_too_late_counts_from_the_next_closing(bench: Bench) -> None:
    to_stand(bench)
    while grip(bench) == "open":
        bench.step()
    bench.run(5.75)
    while grip(bench) == "closed":
        bench.step(arms=ARMS)
    bench.step(arms=OPEN)
    while grip(bench) == "open":
        bench.step(arms=ARMS)
    assert bench.run(0.4) == "staging"
    assert bench.run(0.15) == "acquire"


def test_no_trolley_within_forty_seconds_ends_it(bench: Bench) -> None:
    to_stand(bench)
    for n in range(20 * 39):
        bench.step(drives=bench.roll(-0.99 - 0.005 * ((n % 2) + 1)))
    assert (bench.sequence.phase, waiting(bench)) == ("staging", "trolley")
    for n in range(20 * 2):
        bench.step(drives=bench.roll(-0.99 - 0.005 * ((n % 2) + 1)))
    assert cause(bench) == "no_trolley"


def test_a_trolley_in_the_grippers_is_held_whatever_the_docking_before_left(bench: Bench) -> None:
    ask(bench)
    bench.run(0.2)
    assert bench.mission is not None
    assert grip(bench) == "open"
    bench.ask("abort")
    bench.run(0.2, arms=ARMS)
    bench.ask("start", trolley=2)
    assert (bench.sequence.phase, grip(bench)) == ("acquire", "closed")


@pytest.mark.parametrize(
    ("changes", "lacking"),
    [
        ({"arms": CLOSED}, "trolley not gripped"),
        ({"blind": True}, "LEDs not acquired (few_leds)"),
    ],
)
def test_a_retry_goes_back_with_its_trolley_and_the_leds_in_view(
    bench: Bench, config: Config, changes: dict[str, Any], lacking: str
) -> None:
    bench.to_approach()
    bench.run(2.5)
    bench.step(**bench.there(Pose2(config.docking.goal(1).x_m - 0.2, 0.0, 0.0)))
    assert bench.sequence.phase == "staging"
    assert bench.run(1.9) == "staging"
    assert waiting(bench) == "health"
    valid = bench.seen.state
    given = {key: value for key, value in changes.items() if key != "blind"}
    if "blind" in changes:
        given["state"] = docking_state(config, Pose2(5.0, 0.0, 0.0), valid=False)
    mission = bench.step(**given).mission
    assert (mission.motion, mission.waiting) == ("hold", lacking)
    bench.run(1.9, arms=ARMS, state=valid)
    assert waiting(bench) == "health", "well for two seconds again"
    bench.run(0.3)
    assert bench.mission is not None
    assert bench.mission.motion == "straight"


def test_after_a_retry_it_stands_for_half_a_second_and_goes_on(bench: Bench, config: Config) -> None:
    bench.to_approach()
    bench.run(2.5)
    bench.step(**bench.there(Pose2(config.docking.goal(1).x_m - 0.2, 0.0, 0.0)))
    bench.run(2.3)
    assert bench.mission is not None
    assert bench.mission.motion == "straight"
    bench.step(drives=bench.roll(-2.19))
    bench.step()
    assert waiting(bench) == "standstill"
    while not bench.sequence.attempt.standstill.holds:
        bench.step()
    stands_ns = bench.seen.now_ns
    while bench.run(0.05) == "staging":
        pass
    assert (bench.sequence.phase, bench.seen.now_ns - stands_ns) == ("acquire", NS_PER_S // 2)
    assert not bench.sequence.attempt.retreating
