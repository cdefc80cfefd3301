"""What the arms feel and hold."""

from __future__ import annotations

from dataclasses import replace

import pytest

from common.config import Config
from common.messages import Drives
from follower.arms.handle import HandleHold
from tests.unit.test_supervisor import DRIVES, Bench


def pushing(config: Config, force_n: float, grip_rad: float = 0.0) -> Drives:
    shoulder = force_n * config.arms.lever_m / 2
    torques = (shoulder, 0.0, 0.0, shoulder, 0.0, 0.0)
    return replace(DRIVES, joint_torque_n_m=torques, grip_angle_rad=(grip_rad, grip_rad))


def test_force_comes_from_the_shoulder_torques(config: Config) -> None:
    handle = HandleHold(config.arms)
    for _ in range(60):
        state = handle.feel(pushing(config, 40.0))
    assert state.handle_force_n == pytest.approx(40.0, abs=0.1)


def test_contact_has_hysteresis_and_ignores_a_spike(config: Config) -> None:
    handle, threshold = HandleHold(config.arms), config.arms.contact_force_n
    assert not any(handle.feel(pushing(config, 0.8 * threshold)).contact for _ in range(100))
    assert not handle.feel(pushing(config, 3 * threshold)).contact
    assert not any(handle.feel(pushing(config, 0.0)).contact for _ in range(50))
    assert [handle.feel(pushing(config, 1.5 * threshold)).contact for _ in range(40)][-1]
    assert all(handle.feel(pushing(config, 0.7 * threshold)).contact for _ in range(100))
    assert not [handle.feel(pushing(config, 0.2 * threshold)).contact for _ in range(100)][-1]


def test_a_rigid_connection_takes_more_than_the_guide(config: Config) -> None:
    handle = HandleHold(config.arms)
    states = [handle.feel(pushing(config, 45.0)) for _ in range(100)]
    assert (states[-1].contact, states[-1].connected) == (True, False)
    assert [handle.feel(pushing(config, 100.0)).connected for _ in range(40)][-1]


def test_grippers_report_closed_and_open(config: Config) -> None:
    handle = HandleHold(config.arms)
    assert handle.feel(pushing(config, 0.0, 0.0)).gripped
    state = handle.feel(pushing(config, 0.0, 1.2))
    assert (state.gripped, state.released) == (False, True)


def test_torques_push_while_a_trolley_is_held_and_open_grippers_push_nothing(config: Config) -> None:
    bench = Bench(config)
    mission = bench.step().mission
    held = HandleHold(config.arms).hold(mission)
    assert held.joint_torque_n_m[0] == pytest.approx(config.arms.pushing_force_n * config.arms.lever_m / 2)
    assert held.grip_torque_n_m[0] > 0
    opened = HandleHold(config.arms).hold(replace(mission, grip="open"))
    assert set(opened.joint_torque_n_m) == {0.0}
    assert opened.grip_torque_n_m[0] < 0
