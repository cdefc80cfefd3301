"""What the drives report in a docking: what ends it, and what is armed again."""

from __future__ import annotations

import random
from dataclasses import replace
from typing import Any

import pytest

from common.config import Config
from common.timing import NS_PER_S
from tests.rigs.supervisor_rig import Bench


@pytest.mark.parametrize(
    ("changes", "cause"),
    [
        ({"stop_inputs_clear": False}, "stop_input"),
        ({"state": "fault", "cause": "node 1: EMCY 0x3210"}, "drive_fault: node 1: EMCY 0x3210"),
        ({"state": "stopped", "cause": "second_writer"}, "gate_stop: second_writer"),
        ({"state": "disarmed"}, "drives_disarmed: by themselves"),
        ({"epoch": 7}, "drives_disarmed: by themselves"),
    ],
)
def test_the_drives_can_end_a_docking_in_any_phase(config: Config, changes: dict[str, Any], cause: str) -> None:
    for phase in ("to_approach", "to_push", "to_lock"):
        bench = Bench(config)
        getattr(bench, phase)()
        assert bench.seen.drives is not None
        bench.step(drives=replace(bench.seen.drives, **changes))
        assert bench.mission is not None
        assert (bench.sequence.phase, bench.mission.cause) == ("aborted", cause)
        assert (bench.mission.armed, bench.mission.grip) == (False, "closed")


def test_a_late_command_stops_and_the_approach_goes_on_under_a_new_epoch(bench: Bench) -> None:
    bench.to_approach()
    assert bench.mission is not None
    for number in range(4):
        epoch = bench.mission.epoch
        assert bench.seen.drives is not None
        bench.step(drives=replace(bench.seen.drives, state="stopped", cause="command_age"))
        assert not bench.mission.armed
        if number < 3:
            assert (bench.sequence.phase, bench.mission.epoch) == ("acquire", epoch + 1)
            assert bench.run(0.8, drives=replace(bench.seen.drives, state="disarmed", cause="")) == "approach"
    assert bench.mission.cause == "gate_stop: command_age"


def test_nothing_is_rearmed_while_the_robot_still_rolls(bench: Bench) -> None:
    bench.to_approach()
    drives = bench.seen.drives
    assert drives is not None
    bench.step(drives=replace(drives, state="stopped", cause="status_age"))
    for _ in range(40):
        bench.rolled_m += 0.005
        bench.step(drives=replace(bench.roll(0.0), state="disarmed"))
        assert bench.mission is not None
        assert (bench.sequence.phase, bench.mission.armed) == ("acquire", False)
        assert bench.mission.waiting == "standstill"
    assert bench.run(0.9) == "approach"


def test_wheels_whose_speed_reads_noise_at_rest_stand(bench: Bench) -> None:
    noise = random.Random(1)
    bench.run(0.2)
    assert bench.ask("start").outcome == "accepted"
    for _ in range(15):
        drives = bench.seen.drives
        assert drives is not None
        bench.step(drives=replace(drives, wheel_speed_rad_s=(noise.gauss(0.0, 0.2), noise.gauss(0.0, 0.2))))
    assert bench.sequence.phase == "approach"


def test_who_is_late_now_and_then_only_does_not_end_the_docking(bench: Bench) -> None:
    bench.to_approach()
    for _ in range(6):
        assert bench.seen.drives is not None
        bench.step(drives=replace(bench.seen.drives, state="stopped", cause="status_age"))
        assert bench.sequence.phase == "acquire"
        assert bench.run(7.0, drives=replace(bench.seen.drives, state="disarmed", cause="")) == "approach"
    assert bench.sequence.attempt.rearmed == 6


def test_a_stop_input_reported_once_the_drives_answer_again_ends_it(bench: Bench) -> None:
    bench.to_approach()
    drives = bench.seen.drives
    assert drives is not None
    bench.step(drives=replace(drives, state="stopped", cause="status_age", stop_inputs_clear=False))
    assert bench.sequence.phase == "acquire"
    bench.step(drives=replace(drives, state="disarmed", stop_inputs_clear=False))
    assert bench.mission is not None
    assert (bench.sequence.phase, bench.mission.cause) == ("aborted", "stop_input")


def test_after_a_stall_of_the_machine_the_approach_goes_on(bench: Bench) -> None:
    """Everybody stood still: the supervisor looks before the bridge speaks again, and that has stopped by name."""
    bench.to_approach()
    drives = bench.seen.drives
    assert drives is not None
    bench.seen = replace(bench.seen, now_ns=bench.seen.now_ns + 2 * NS_PER_S)
    bench.step(drives=None)
    bench.step(drives=replace(drives, state="stopped", cause="bridge_stalled"))
    assert bench.sequence.phase == "acquire"
    bench.seen = replace(bench.seen, drives=replace(drives, state="disarmed"))
    assert bench.run(1.0) == "approach"


@pytest.mark.parametrize(
    "cause",
    [
        "node_silent: left wheel: node 1 is silent",
        "bad_frames: CAN bus: 3 frames",
        "bus_lost: CAN bus follower: bus-off",
    ],
)
def test_what_passes_on_the_bus_stops_it_until_it_is_over(bench: Bench, cause: str) -> None:
    """docs/safety.md S19, S21, S23: S1. The stop inputs are silent with the whole bus; that is no pressed button."""
    bench.to_approach()
    drives = bench.seen.drives
    assert drives is not None
    bench.step(drives=replace(drives, state="stopped", cause=cause, stop_inputs_clear=cause.startswith("bad")))
    assert bench.run(2.0) == "acquire"
    assert bench.mission is not None
    assert (bench.mission.armed, bench.mission.waiting) == (False, cause)
    assert bench.run(0.8, drives=replace(drives, state="disarmed", cause="")) == "approach"


def test_in_contact_a_late_command_ends_the_docking(bench: Bench) -> None:
    bench.to_push()
    assert bench.seen.drives is not None
    bench.step(drives=replace(bench.seen.drives, state="stopped", cause="command_age"))
    assert bench.mission is not None
    assert (bench.sequence.phase, bench.mission.grip) == ("aborted", "closed")


def test_messages_that_cannot_be_decoded_disarm_and_out_of_contact_it_goes_on(bench: Bench) -> None:
    bench.to_approach()
    assert bench.mission is not None
    epoch = bench.mission.epoch
    bench.step(malformed="follower-estimator")
    assert (bench.sequence.phase, bench.mission.armed, bench.mission.epoch) == ("acquire", False, epoch + 1)
    bench.run(1.0, malformed="follower-estimator")
    assert (bench.mission.armed, bench.mission.waiting) == (False, "malformed messages of follower-estimator")
    assert bench.run(0.8, malformed="") == "approach"


def test_messages_that_cannot_be_decoded_end_a_docking_in_contact(bench: Bench) -> None:
    bench.to_push()
    bench.step(malformed="follower-arms")
    assert bench.mission is not None
    assert (bench.sequence.phase, bench.mission.cause) == ("aborted", "bad_message: of follower-arms")
    assert bench.mission.needs_reset
