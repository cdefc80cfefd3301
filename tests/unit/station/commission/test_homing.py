"""Homing of axes with incremental encoders: on the operator's word, by limit switch or where they stand."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from common.config import FollowerCanConfig, HomingConfig, load_config
from common.errors import ConfigError, DeviceError
from follower.can_bridge.measurement import DriveSetpoint
from sim.can.drive_402 import Drive402
from station.commission.homing import Homing
from tests.rigs.canbus_rig import CONFIG_PATH, Rig, RigClock, follower_rig, rig_with, stepped_config

DOWN = HomingConfig(method=17, position=0.0, search_speed=0.04, zero_speed=0.005, acceleration=0.2)
# a motor that turns the other way meets its negative limit switch at the axis' upper end
OUT = HomingConfig(method=17, position=1.1, search_speed=0.3, zero_speed=0.05, acceleration=1.0)


def homed_config(lift: HomingConfig = DOWN, joint: HomingConfig = OUT) -> FollowerCanConfig:
    """The lift and the right arm's first joint, whose motor turns the other way, have incremental encoders."""
    config = stepped_config().follower_can
    joints = list(config.joints)
    joints[3] = joints[3].model_copy(update={"homing": joint, "sign": -1})
    changed = {"joints": tuple(joints), "lift": config.lift.model_copy(update={"homing": lift})}
    return FollowerCanConfig.model_validate(config.model_copy(update=changed).model_dump())


@contextmanager
def rig(config: FollowerCanConfig) -> Iterator[Rig]:
    """Lift and joint follow their drives; they stand at 0.07 m and 0.4 rad when switched on."""
    with rig_with(config) as made:
        for drive, start in ((made.robot.lift, 0.07), (made.robot.joints[3], 0.4)):
            drive.set_measured(start, 0.0, 0.0)
            drive.sampled()
            _follow(drive)
        yield made


def _follow(drive: Drive402) -> None:
    moved = drive.moved

    def follow(elapsed_s: float) -> None:
        moved(elapsed_s)
        if drive.effort == "position":
            drive.set_measured(drive.position_setpoint, 0.0, 0.0)

    drive.__dict__["moved"] = follow


def home(made: Rig) -> list[Any]:
    return list(Homing(made.config, CONFIG_PATH, RigClock(made)).run())


def test_a_bridge_refuses_an_axis_that_is_not_homed() -> None:
    with rig(homed_config()) as made:
        with pytest.raises(DeviceError, match=r"node 21 \(right joint 1\): not homed: run davpc can home"):
            made.drives.open()
        assert not any(drive.enabled for drive in made.robot.drives)


def test_homed_axes_know_where_they_are() -> None:
    with rig(homed_config()) as made:
        checks = home(made)
        assert [(check.name, check.passed) for check in checks] == [("right joint 1", True), ("lift", True)]
        assert not any(drive.enabled for drive in made.robot.drives)
        true_lift, true_joint = made.robot.lift._measured[0], made.robot.joints[3]._measured[0]
        assert true_lift == pytest.approx(0.0, abs=1e-3)
        assert true_joint == pytest.approx(1.1, abs=0.01)
        measured = made.enable()
        assert measured.troubles == ()
        assert measured.lift_m == pytest.approx(true_lift, abs=1e-3)
        assert measured.joint_angle_rad[3] == pytest.approx(true_joint, abs=0.01)
        made.cycles(200, DriveSetpoint(lift_m=0.05))
        assert made.robot.lift.position_setpoint == pytest.approx(0.05, abs=1e-3)


def test_home_where_it_stands() -> None:
    here = HomingConfig(method=37, position=0.12, search_speed=0.1, zero_speed=0.1, acceleration=1.0)
    with rig(homed_config(lift=here)) as made:
        assert home(made)[-1].passed
        assert made.robot.lift._measured[0] == 0.07
        assert made.enable().lift_m == pytest.approx(0.12, abs=1e-5)


def test_a_method_that_the_drive_does_not_know_fails_by_name() -> None:
    odd = DOWN.model_copy(update={"method": 5})
    with rig(homed_config(lift=odd)) as made:
        assert home(made)[-1].result == "the drive reports a homing error"
        assert not any(drive.enabled for drive in made.robot.drives)


def test_a_switch_that_never_comes_ends_in_time() -> None:
    short = DOWN.model_copy(update={"timeout_s": 0.5})
    with rig(homed_config(lift=short)) as made:
        assert home(made)[-1].result == "home not found in 0.5 s"
        made.pass_time(200)
        assert not made.robot.lift.enabled


def test_a_stop_input_ends_it() -> None:
    with rig(homed_config()) as made:
        made.robot.set_stop_inputs(estop_clear=False, protective_clear=True)
        checks = home(made)
        assert (len(checks), checks[0].passed, checks[0].result) == (1, False, "a stop input is active")


def test_without_such_an_axis_there_is_nothing_to_home() -> None:
    with follower_rig() as made, pytest.raises(ConfigError, match="no drive has homing"):
        Homing(made.config, CONFIG_PATH, RigClock(made))


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("follower_can.left_wheel.homing={HOMING}", "homing is for joints and lift"),
        ("follower_can.lift.zero_counts=5", "zero_counts belongs to an absolute encoder"),
    ],
)
def test_configuration_of_homing_is_checked(override: str, message: str) -> None:
    text = "{ method = 17, position = 0.0, search_speed = 0.1, zero_speed = 0.1, acceleration = 1.0 }"
    with pytest.raises(ConfigError, match=message):
        load_config(CONFIG_PATH, [f"follower_can.lift.homing={text}", override.replace("{HOMING}", text)])
