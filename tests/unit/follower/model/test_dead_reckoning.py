"""Dead reckoning: where the array must be, how far off it may be, and when nothing is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from common.config import Config
from common.geometry import Pose2
from common.messages import Drives
from common.timing import NS_PER_S
from follower.model.dead_reckoning import DeadReckoning, WheelReckoning
from tests.rigs.supervisor_rig import DRIVES, docking_state

COVARIANCE = np.diag([0.01, 0.01, 0.01]) ** 2


def agrees(reckoning: DeadReckoning, pose: Pose2) -> bool:
    return bool(reckoning.agrees(pose.as_array()[None], COVARIANCE[None])[0])


def test_nothing_is_known_before_the_first_sight_and_after_forgetting(config: Config) -> None:
    reckoning = DeadReckoning(config.estimator)
    assert reckoning.leader_in_follower is None
    assert agrees(reckoning, Pose2(50.0, 0.0, 0.0))
    reckoning.seen(Pose2(5.0, 0.2, 0.1), COVARIANCE, 0)
    assert not agrees(reckoning, Pose2(6.0, 0.2, 0.1))
    reckoning.forget()
    assert (reckoning.known, reckoning.leader_in_follower) == (False, None)


def test_it_is_carried_on_by_the_wheels_and_grows_less_sure_up_to_a_neighbours_distance(config: Config) -> None:
    reckoning = DeadReckoning(config.estimator)
    reckoning.seen(Pose2(3.0, 0.0, 0.0), COVARIANCE, 0)
    assert not agrees(reckoning, Pose2(3.6, 0.0, 0.0))
    for n in range(1, 61):
        reckoning.drive(n * NS_PER_S // 60, (0.5, 0.0))
    pose = reckoning.leader_in_follower
    assert pose is not None
    assert (pose.x_m, pose.y_m) == pytest.approx((2.5, 0.0))
    assert agrees(reckoning, Pose2(3.1, 0.0, 0.0))
    for n in range(61, 301):
        reckoning.drive(n * NS_PER_S // 60, (0.5, 0.0))
    assert agrees(reckoning, Pose2(0.9, 0.0, 0.0))
    assert not agrees(reckoning, Pose2(1.7, 0.0, 0.0))


def _drives(config: Config, time_s: float, driven_m: float) -> Drives:
    angle = driven_m / config.base.wheel_radius_m
    measured_ns = round(time_s * NS_PER_S)
    return replace(DRIVES, state="armed", epoch=1, measured_ns=measured_ns, wheel_angle_rad=(angle, angle))


def test_a_state_is_carried_on_by_the_drives_measured_angles(config: Config) -> None:
    reckoning = WheelReckoning(config.base, config.estimator)
    reckoning.drive(_drives(config, 1.0, 0.0))
    reckoning.seen(docking_state(config, Pose2(5.0, 0.0, 0.0)))
    for n in range(1, 21):
        reckoning.drive(_drives(config, 1.0 + 0.05 * n, 0.02 * n))
    pose = reckoning.leader_in_follower
    assert pose is not None
    assert pose.x_m == pytest.approx(4.6)
    assert reckoning.agrees(docking_state(config, Pose2(4.65, 0.0, 0.0)))
    assert not reckoning.agrees(docking_state(config, Pose2(6.5, 0.0, 0.0)))


def test_a_jump_of_an_encoder_forgets_it(config: Config) -> None:
    reckoning = WheelReckoning(config.base, config.estimator)
    reckoning.drive(_drives(config, 1.0, 0.0))
    reckoning.seen(docking_state(config, Pose2(5.0, 0.0, 0.0)))
    reckoning.drive(_drives(config, 1.05, 3.0))
    assert reckoning.leader_in_follower is None
    reckoning.seen(docking_state(config, Pose2(4.0, 0.0, 0.0)))
    reckoning.drive(_drives(config, 1.10, 3.01))
    pose = reckoning.leader_in_follower
    assert pose is not None
    assert pose.x_m == pytest.approx(3.99)
