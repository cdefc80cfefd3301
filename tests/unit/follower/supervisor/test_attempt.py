"""What the phases of a docking share: battery, silence, re-arming."""

from __future__ import annotations

from dataclasses import replace

import pytest

from common.config import Config
from common.geometry import Pose2
from common.timing import NS_PER_S
from follower.supervisor.attempt import not_enabled, undervoltage
from tests.rigs.supervisor_rig import DRIVES, LEADER, Bench


@pytest.mark.parametrize(
    ("volts", "said"), [(22.0, ""), (21.99, "battery at 22.0 V"), (None, "battery voltage not re")]
)
def test_a_battery_below_its_limit_or_not_readable_is_named(config: Config, volts: float | None, said: str) -> None:
    text = undervoltage(config.base, replace(DRIVES, battery_v=volts))
    assert text.startswith(said)
    assert bool(text) == bool(said)


def test_without_a_limit_or_without_drives_no_battery_is_judged(config: Config) -> None:
    unlimited = config.base.model_copy(update={"battery_min_v": 0.0})
    assert undervoltage(unlimited, replace(DRIVES, battery_v=None)) == ""
    assert undervoltage(config.base, None) == ""


def test_drives_that_are_not_enabled_are_named_with_their_cause() -> None:
    assert not_enabled(None) == "drives not enabled"
    assert not_enabled(DRIVES) == "drives not enabled"
    assert not_enabled(replace(DRIVES, cause="bus_lost: off")) == "drives not enabled (bus_lost: off)"


@pytest.mark.parametrize(("after_s", "phase"), [(19.9, "aborted"), (20.1, "acquire")])
def test_three_may_be_rearmed_within_twenty_seconds(bench: Bench, after_s: float, phase: str) -> None:
    bench.to_approach()
    drives = bench.seen.drives
    assert drives is not None
    began_ns = bench.seen.now_ns
    for number in range(4):
        if number == 3:
            late_ns = began_ns + round(after_s * NS_PER_S)
            bench.run(10.0)
            bench.step(**bench.there(Pose2(4.0, 0.1, 0.0)))  # it came nearer meanwhile
            drives = bench.seen.drives
            assert drives is not None
            bench.run((late_ns - bench.seen.now_ns) / NS_PER_S)
        bench.step(drives=replace(drives, state="stopped", cause="command_age", epoch=bench.sequence.attempt.epoch))
        if number < 3:
            assert bench.run(1.0, drives=replace(drives, state="disarmed", cause="")) == "approach"
    assert bench.sequence.phase == phase


def test_an_open_lock_says_enough_for_the_first_trolley(bench: Bench) -> None:
    bench.run(0.2, leader=replace(LEADER, queue=2))
    bench.ask("start")
    assert bench.run(0.7) == "approach"


def test_a_pressed_button_keeps_it_from_arming(bench: Bench) -> None:
    bench.run(0.2)
    assert bench.seen.drives is not None
    bench.step(drives=replace(bench.seen.drives, state="stopped", cause="status_age", stop_inputs_clear=False))
    bench.ask("start")
    mission = bench.step().mission
    assert (mission.armed, mission.waiting) == (False, "stop input")
