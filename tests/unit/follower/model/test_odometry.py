"""How far the wheels went, and which of their measurements count."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.config import Config
from common.geometry import Pose2, move_relative
from common.kinematics import path_from_wheels, twist_from_wheels, wheels_from_twist
from common.timing import NS_PER_MS
from follower.model.odometry import PoseIncrement, WheelOdometry

STEP_NS = 10 * NS_PER_MS


def increment(found: object) -> PoseIncrement:
    assert isinstance(found, PoseIncrement)
    return found


def arc(distance_m: float, turn_rad: float) -> Pose2:
    """The new {F} in the old one."""
    return move_relative(Pose2(0.0, 0.0, 0.0), distance_m, turn_rad, 1.0).inverse()


def drive(odometry: WheelOdometry, steps: list[tuple[float, float]]) -> tuple[Pose2, PoseIncrement]:
    """The pose after wheel turns [rad], each 10 ms long, and the last increment."""
    angles, now_ns = (0.3, -0.2), STEP_NS
    assert odometry.advance(now_ns, angles) == "first"
    pose, last = Pose2(0.0, 0.0, 0.0), PoseIncrement(0.0, 0.0, 0)
    for left, right in steps:
        angles, now_ns = (angles[0] + left, angles[1] + right), now_ns + STEP_NS
        last = increment(odometry.advance(now_ns, angles))
        pose = pose.compose(arc(last.distance_m, last.turn_rad))
    return pose, last


@given(v=st.floats(-0.5, 0.5), w=st.floats(-0.6, 0.6))
def test_wheels_and_twist_are_inverse_and_the_path_is_their_integral(config: Config, v: float, w: float) -> None:
    wheels = wheels_from_twist(config.base, v, w)
    assert twist_from_wheels(config.base, wheels) == pytest.approx((v, w), abs=1e-12)
    assert path_from_wheels(config.base, (2 * wheels[0], 2 * wheels[1])) == pytest.approx((2 * v, 2 * w), abs=1e-12)


@given(v=st.floats(-0.5, 0.5), w=st.floats(-0.6, 0.6))
def test_an_increment_has_its_mean_twist(config: Config, v: float, w: float) -> None:
    left, right = wheels_from_twist(config.base, v, w)
    _, last = drive(WheelOdometry(config.base), [(left * 0.01, right * 0.01)])
    assert last.twist == pytest.approx((v, w), abs=1e-9)
    assert last.duration_ns == STEP_NS


def test_a_full_circle_comes_back(config: Config) -> None:
    base = config.base
    left, right = wheels_from_twist(base, 0.3, 0.5)
    count = round(2 * math.pi / 0.5 / 0.01)
    scale = 2 * math.pi / (count * 0.5)
    pose, _ = drive(WheelOdometry(base), [(left * scale, right * scale)] * count)
    assert math.hypot(pose.x_m, pose.y_m) < 1e-9
    assert abs(pose.theta_rad) < 1e-9


def test_a_dropped_measurement_loses_nothing(config: Config) -> None:
    base = config.base
    left, right = wheels_from_twist(base, 0.3, 0.5)
    dense, _ = drive(WheelOdometry(base), [(left * 0.01, right * 0.01)] * 40)
    odometry = WheelOdometry(base)
    odometry.advance(0, (0.0, 0.0))
    sparse = increment(odometry.advance(40 * STEP_NS, (left * 0.4, right * 0.4)))
    assert arc(sparse.distance_m, sparse.turn_rad).as_array() == pytest.approx(dense.as_array(), abs=1e-9)


def test_old_and_impossible_measurements_make_no_increment(config: Config) -> None:
    odometry = WheelOdometry(config.base)
    assert odometry.advance(STEP_NS, (1.0, 1.0)) == "first"
    assert odometry.advance(STEP_NS, (1.1, 1.1)) == "repeated"
    assert odometry.advance(2 * STEP_NS, (9.0, 1.0)) == "jump"
    following = increment(odometry.advance(3 * STEP_NS, (9.01, 1.01)))
    assert following.distance_m == pytest.approx(0.01 * config.base.wheel_radius_m)
    assert odometry.advance(4 * STEP_NS, (math.nan, 1.0)) == "jump"
    assert odometry.advance(5 * STEP_NS, (9.0, 1.0)) == "first"
