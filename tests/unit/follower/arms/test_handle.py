"""What the arms feel and hold, all together."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from common.config import Config
from common.messages import Drives
from common.timing import NS_PER_MS
from experiments.contact.handle_bench import resting_mission
from follower.arms.handle import HandleHold
from follower.arms.posture import PostureTracker, handle_force
from tests.rigs.arms_rig import EMPTY, GRIPPED, OPEN, holding_angles
from tests.rigs.supervisor_rig import DRIVES


def measured(config: Config, now_ms: int, **changes: object) -> Drives:
    base = replace(
        DRIVES, state="armed", epoch=1, measured_ns=now_ms * NS_PER_MS, joint_angle_rad=holding_angles(config),
        grip_angle_rad=GRIPPED, grip_torque_n_m=(config.arms.grip_torque_n_m,) * 2,
    )  # fmt: skip
    return replace(base, **changes)  # type: ignore[arg-type]


def test_a_slip_is_named_until_the_next_epoch_and_the_arms_yield(config: Config) -> None:
    hold, mission = HandleHold(config.arms, config.base), resting_mission(config)
    for now in range(0, 1000, 10):
        drives = measured(config, now)
        assert hold.feel(drives, mission).cause == "ok"
        hold.hold(drives, mission)
    drives = measured(config, 1000, grip_angle_rad=EMPTY)
    assert hold.feel(drives, mission).cause == "slip"
    setpoint = hold.hold(drives, mission)
    assert max(map(abs, setpoint.joint_torque_n_m)) < 0.1
    assert setpoint.grip_torque_n_m == (config.arms.grip_torque_n_m,) * 2
    assert hold.feel(measured(config, 1010), mission).cause == "slip"
    assert hold.feel(measured(config, 1020), replace(mission, epoch=2)).cause == "ok"


def test_grippers_report_what_they_hold(config: Config) -> None:
    mission = resting_mission(config)
    for grip, expected in ((GRIPPED, (True, False)), (OPEN, (False, True)), (EMPTY, (False, False))):
        state = HandleHold(config.arms, config.base).feel(measured(config, 10, grip_angle_rad=grip), mission)
        assert (state.gripped, state.released) == expected


@pytest.mark.parametrize("lift_m", [-1e9, 2.5, 163.0, 1e9])
def test_a_lift_and_joints_that_read_anything_still_give_a_setpoint(config: Config, lift_m: float) -> None:
    hold, mission = HandleHold(config.arms, config.base), resting_mission(config)
    for state in ("disarmed", "armed"):
        drives = measured(config, 10, state=state, lift_m=lift_m, joint_angle_rad=(1e11,) * 6)
        hold.feel(drives, mission)
        assert 0.0 <= hold.hold(drives, mission).lift_m <= 2.0


def test_nothing_jumps_when_the_drives_begin_to_obey(config: Config) -> None:
    hold, mission = HandleHold(config.arms, config.base), resting_mission(config)
    joint_angle_rad = holding_angles(config, config.arms.handle_x_m - 0.04)
    torques = []
    for now in range(0, 600, 10):
        state = "enabling" if now < 300 else "armed"
        drives = measured(config, now, state=state, joint_angle_rad=joint_angle_rad)
        hold.feel(drives, mission)
        torques.append(hold.hold(drives, mission).joint_torque_n_m)
    steps = [max(abs(b - a) for a, b in zip(*pair, strict=True)) for pair in pairwise(torques)]
    assert max(steps) < 0.5
    assert max(map(abs, torques[-1])) > 3.0


def test_the_push_follows_the_measured_resistance_and_the_commanded_direction(config: Config) -> None:
    hold, mission = HandleHold(config.arms, config.base), resting_mission(config)
    posture = PostureTracker(config.arms).posture(holding_angles(config), 0)
    torque = tuple(float(t) for jacobian in posture.jacobians for t in jacobian.T @ np.array([6.0, 0.0, 0.0]))

    def pushed(first_ms: int, speed_m_s: float) -> float:
        for now in range(first_ms, first_ms + 5000, 10):
            drives = measured(config, now, joint_torque_n_m=torque, v_set_m_s=speed_m_s)
            hold.feel(drives, mission)
            setpoint = hold.hold(drives, mission)
        return float(handle_force(posture, setpoint.joint_torque_n_m)[0])

    assert pushed(0, 0.0) == pytest.approx(0.0, abs=0.01)
    assert 6.0 < pushed(5000, 0.2) < 12.0
    assert pushed(10_000, -0.1) == pytest.approx(0.0, abs=0.01)


def test_after_a_stop_the_arms_hold_under_the_armed_epoch_until_the_base_stands(config: Config) -> None:
    hold, mission = HandleHold(config.arms, config.base), resting_mission(config)
    ahead = holding_angles(config, config.arms.handle_x_m + 0.03)
    torques, epochs = [], []
    for now in range(0, 2000, 10):
        state, angle = ("armed", now * 1e-3) if now < 1000 else ("stopped", min(now, 1400) * 1e-3)
        drives = measured(config, now, state=state, wheel_angle_rad=(angle, angle), joint_angle_rad=ahead)
        hold.feel(drives, mission)
        setpoint = hold.hold(drives, replace(mission, epoch=1 if now < 1000 else 2))
        torques.append(max(map(abs, setpoint.joint_torque_n_m)))
        epochs.append(setpoint.epoch)
    assert min(torques[50:140]) > 1.0
    assert epochs[100:140] == [1] * 40
    assert max(torques[170:]) < 0.1
    assert epochs[-1] == 2


def test_after_a_stop_nothing_that_the_trolley_touches_is_pressed_on(config: Config) -> None:
    hold, mission = HandleHold(config.arms, config.base), resting_mission(config)
    posture = PostureTracker(config.arms).posture(holding_angles(config), 0)
    pressed = tuple(float(t) for jacobian in posture.jacobians for t in jacobian.T @ np.array([60.0, 0.0, 0.0]))
    joints = holding_angles(config, config.arms.handle_x_m - 0.03)
    for now in range(0, 2000, 10):
        share = min(1.0, max(0.0, (now - 500) / 1000))
        drives = measured(
            config, now, state="armed" if now < 1900 else "disarmed", v_set_m_s=0.1 if now < 1900 else 0.0,
            wheel_angle_rad=(now * 1e-3,) * 2, joint_angle_rad=joints,
            joint_torque_n_m=tuple(share * torque for torque in pressed),
        )  # fmt: skip
        felt = hold.feel(drives, mission)
        setpoint = hold.hold(drives, mission)
    assert (felt.cause, felt.contact or felt.connected, hold.led) == ("ok", True, True)
    assert max(map(abs, setpoint.joint_torque_n_m)) < 0.1
