"""Arming, stopping and resetting: what the bridge decides around the gate."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from common.config import Config
from common.timing import NS_PER_S
from tests.rigs.bridge_rig import Rig
from tests.rigs.supervisor_rig import Bench


@pytest.fixture
def rig(config: Config) -> Rig:
    bench = Bench(config)
    rig = Rig(config, bench.step().mission)
    assert rig.run() == "disarmed"
    bench.to_approach()
    assert bench.mission is not None
    rig.mission = bench.mission
    assert rig.run(3) == "armed"
    return rig


@pytest.mark.parametrize(
    ("trouble", "state", "cause"),
    [
        ({"faults": ("left wheel: over-current",)}, "fault", "left wheel: over-current"),
        ({"silent": ("left wheel: node 1 is silent",)}, "stopped", "node_silent: left wheel: node 1 is silent"),
        ({"bad_frames": "CAN bus: 3 frames"}, "stopped", "bad_frames: CAN bus: 3 frames"),
        ({"silent": ("lift: silent",), "faults": ("left wheel: over-current",)}, "fault", "left wheel: over-current"),
    ],
)
def test_what_was_wrong_for_a_moment_is_kept_until_a_new_epoch(
    rig: Rig, trouble: dict[str, Any], state: str, cause: str
) -> None:
    rig.measured = replace(rig.measured, **trouble)
    assert rig.run() == state
    rig.measured = replace(rig.measured, faults=(), silent=(), bad_frames="")
    assert rig.run(20) == "stopped"
    assert rig.bridge.cause == cause
    rig.mission = replace(rig.mission, armed=False)
    rig.run(2)
    rig.mission = replace(rig.mission, armed=True, epoch=rig.mission.epoch + 1)
    assert rig.run(2) == "armed"


def test_a_silence_ends_only_when_the_stop_inputs_have_been_read_again(rig: Rig) -> None:
    rig.measured = replace(rig.measured, bus_lost="bus-off", inputs_fresh=False)
    assert rig.run() == "stopped"
    rig.mission = replace(rig.mission, armed=False, epoch=rig.mission.epoch + 1)
    rig.measured = replace(rig.measured, bus_lost="")
    rig.run(5)
    assert (rig.bridge.state, rig.bridge.cause) == ("stopped", "bus_lost: bus-off")
    rig.measured = replace(rig.measured, inputs_fresh=True)
    assert rig.run() == "disarmed"
    rig.measured = replace(rig.measured, inputs_fresh=False)
    assert rig.run() == "disarmed"


@pytest.mark.parametrize(
    ("angles", "cause"),
    [({"wheel_angle_rad": (0.0, 0.7)}, "measured_jump"), ({"joint_angle_rad": (0.3, *(0.0,) * 5)}, "arm_jump")],
)
def test_an_encoder_whose_angle_jumps_stops_and_disarms(rig: Rig, angles: dict[str, Any], cause: str) -> None:
    rig.commanded = True
    assert rig.run(5) == "armed"
    rig.measured = replace(rig.measured, **angles)
    assert rig.run() == "stopped"
    assert rig.bridge.cause == cause
    assert rig.run(20) == "stopped"
    rig.mission = replace(rig.mission, epoch=rig.mission.epoch + 1)
    assert rig.run(2) == "armed"


def test_arms_are_not_enabled_before_their_first_setpoint_under_the_new_epoch(rig: Rig) -> None:
    rig.mission = replace(rig.mission, armed=False)
    assert rig.run(2) == "disarmed"
    rig.mission = replace(rig.mission, armed=True, epoch=rig.mission.epoch + 1)
    rig.arms_lag = True
    rig.measured = replace(rig.measured, arms_enabled=False)
    rig.power.clear()
    assert rig.run(30) == "enabling"
    assert rig.bridge.cause == "arm_epoch"
    assert set(rig.power) == {"stop_arms"}
    rig.arms_lag = False
    assert rig.run() == "enabling"
    assert rig.power[-1] == "enable"
    rig.measured = replace(rig.measured, arms_enabled=True)
    assert rig.run() == "armed"


def test_wheels_that_are_still_in_operation_wait_for_the_arms(rig: Rig) -> None:
    rig.mission = replace(rig.mission, armed=False)
    rig.run(2)
    rig.mission = replace(rig.mission, armed=True, epoch=rig.mission.epoch + 1, v_max_m_s=0.3)
    rig.arms_lag, rig.commanded, rig.v_m_s = True, True, 0.2
    rig.measured = replace(rig.measured, arms_enabled=False)
    assert rig.run(30) == "enabling"
    assert rig.setpoint.left_rad_s == rig.setpoint.right_rad_s == 0.0
    rig.arms_lag = False
    rig.measured = replace(rig.measured, arms_enabled=True)
    assert rig.run(30) == "armed"
    assert rig.setpoint.left_rad_s > 0.0


def test_a_first_enabling_that_is_broken_off_leaves_the_arms_holding(config: Config, rig: Rig) -> None:
    fresh = Rig(config, replace(rig.mission, armed=False))
    assert fresh.run(2) == "disarmed"
    fresh.mission = rig.mission
    fresh.measured = replace(fresh.measured, wheels_enabled=False, arms_enabled=False)
    assert fresh.run(2) == "enabling"
    assert fresh.power[-1] == "enable"
    fresh.token_ns = fresh.now_ns - NS_PER_S
    assert fresh.run(2) == "stopped"
    assert fresh.power[-1] == "stop_arms"


def test_a_token_that_goes_old_before_the_drives_follow_ends_the_epoch(rig: Rig) -> None:
    rig.mission = replace(rig.mission, epoch=rig.mission.epoch + 1)
    rig.measured = replace(rig.measured, wheels_enabled=False)
    assert rig.run(3) == "enabling"
    rig.token_ns = rig.now_ns
    assert rig.run(19) == "enabling"
    assert rig.run(4) == "stopped"
    assert rig.bridge.cause == "token_age"
    rig.token_ns = None
    assert rig.run(5) == "stopped"


def test_a_restarted_bridge_refuses_the_epoch_that_it_finds_armed(config: Config, rig: Rig) -> None:
    fresh = Rig(config, rig.mission)
    assert fresh.run(50) == "stopped"
    assert fresh.bridge.cause == "bridge_restarted"
    assert "enable" not in fresh.power


def test_after_a_stall_of_the_bridge_a_new_epoch_waits_until_the_latch_is_released(rig: Rig) -> None:
    rig.measured = replace(rig.measured, stalled="bridge: stalled for 99 ms", wheels_enabled=False)
    rig.roll(2.0, 2.0)
    assert rig.run(10) == "stopped"
    assert rig.bridge.cause == "bridge_stalled"
    rig.mission = replace(rig.mission, epoch=rig.mission.epoch + 1)
    rig.power.clear()
    assert rig.run(100) == "enabling"
    rig.roll(0.0, 0.0)
    assert rig.run(65) == "enabling"
    assert set(rig.power) == {"stop_arms"}
    assert rig.run(10) == "enabling"
    assert rig.power[-1] == "disable"
    assert "enable" not in rig.power
    rig.measured = replace(rig.measured, stalled="")
    assert rig.run(2) == "enabling"
    assert rig.power[-1] == "enable"
    rig.measured = replace(rig.measured, wheels_enabled=True)
    assert rig.run(2) == "armed"


def test_a_stall_stops_the_epoch_in_which_it_came_for_good(rig: Rig) -> None:
    rig.measured = replace(rig.measured, stalled="bridge: stalled for 99 ms")
    assert rig.run(3) == "stopped"
    rig.measured = replace(rig.measured, stalled="")
    assert rig.run(60) == "stopped"
    assert rig.bridge.cause == "bridge_stalled"


def test_armed_and_never_commanded_it_stops_by_name(rig: Rig) -> None:
    assert rig.run(190) == "armed"
    assert rig.run(20) == "stopped"
    assert rig.bridge.cause == "no_command"
    rig.mission = replace(rig.mission, epoch=rig.mission.epoch + 1)
    assert rig.run(190) == "armed"


def test_faults_are_acknowledged_once_on_request_and_only_disarmed(rig: Rig) -> None:
    rig.mission = replace(rig.mission, resets=1)
    rig.run(3)
    assert "reset" not in rig.power
    rig.mission = replace(rig.mission, armed=False)
    rig.run(3)
    rig.mission = replace(rig.mission, resets=2)
    rig.run(5)
    assert rig.power.count("reset") == 1


def test_disarmed_it_disables_after_half_a_second_of_standstill(rig: Rig) -> None:
    rig.run(20)
    rig.mission = replace(rig.mission, armed=False)
    rig.power.clear()
    rig.run(50)
    assert "disable" not in rig.power
    rig.run()
    assert rig.power[-1] == "disable"


@pytest.mark.parametrize("speeds", [(2.0, 2.0), (-0.1, 0.1)])
def test_it_does_not_disable_while_it_drives_or_turns_on_the_spot(rig: Rig, speeds: tuple[float, float]) -> None:
    rig.mission = replace(rig.mission, armed=False)
    rig.roll(*speeds)
    rig.run(200)
    assert "disable" not in rig.power
    rig.roll(0.0, 0.0)
    rig.run(50)
    assert "disable" not in rig.power
    rig.run(22)
    assert rig.power[-1] == "disable"


def test_wheels_whose_speed_reads_noise_at_rest_stand(rig: Rig) -> None:
    rig.run(20)
    rig.mission = replace(rig.mission, armed=False)
    for n in range(51):
        noise = 0.2 if n % 2 else -0.2
        rig.measured = replace(rig.measured, wheel_speed_rad_s=(noise, noise))
        rig.run()
    assert rig.power[-1] == "disable"


def test_the_arms_are_led_while_the_base_brakes_and_hold_once_it_stands(rig: Rig) -> None:
    rig.run(20)
    rig.roll(2.0, 2.0)
    rig.token_ns = rig.now_ns - NS_PER_S
    rig.power.clear()
    assert rig.run(50) == "stopped"
    assert set(rig.power) == {None}
    rig.roll(0.0, 0.0)
    rig.run(30)
    assert rig.power[-1] == "stop_arms"
    rig.roll(2.0, 2.0)
    rig.run(30)
    assert rig.power[-1] == "stop_arms"


def test_arms_without_a_setpoint_or_for_too_long_are_not_led_by_a_base_that_rolls(rig: Rig) -> None:
    rig.roll(2.0, 2.0)
    rig.run(3)
    rig.token_ns = rig.now_ns - NS_PER_S
    rig.run(250)
    assert rig.power[-1] == "stop_arms"
    rig.token_ns = None
    rig.mission = replace(rig.mission, epoch=rig.mission.epoch + 1)
    assert rig.run(3) == "armed"
    rig.arms_lag = True
    rig.mission = replace(rig.mission, armed=False)
    rig.run(2)
    assert rig.power[-1] == "stop_arms"
