"""How far the wheels went, and how well that is known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.config import Config
from common.geometry import Array, Pose2
from common.kinematics import arc, path_from_wheels, twist_from_wheels, wheels_from_twist
from common.timing import NS_PER_MS
from follower.model.odometry import PoseIncrement, WheelNoise, WheelOdometry

STEP_NS = 10 * NS_PER_MS


def increment(found: object) -> PoseIncrement:
    assert isinstance(found, PoseIncrement)
    return found


def drive(odometry: WheelOdometry, steps: list[tuple[float, float]]) -> PoseIncrement:
    """All increments of wheel turns [rad], each 10 ms long, as one."""
    angles, now_ns = (0.3, -0.2), STEP_NS
    assert odometry.advance(now_ns, angles) == "first"
    total: PoseIncrement | None = None
    for left, right in steps:
        angles, now_ns = (angles[0] + left, angles[1] + right), now_ns + STEP_NS
        found = increment(odometry.advance(now_ns, angles))
        total = found if total is None else total.then(found)
    assert total is not None
    return total


@given(v=st.floats(-0.5, 0.5), w=st.floats(-0.6, 0.6))
def test_wheels_and_twist_are_inverse_and_the_path_is_their_integral(config: Config, v: float, w: float) -> None:
    wheels = wheels_from_twist(config.base, v, w)
    assert twist_from_wheels(config.base, wheels) == pytest.approx((v, w), abs=1e-12)
    assert path_from_wheels(config.base, (2 * wheels[0], 2 * wheels[1])) == pytest.approx((2 * v, 2 * w), abs=1e-12)


def test_an_arc_is_a_circle() -> None:
    quarter = arc(math.pi / 2, math.pi / 2)
    assert (quarter.x_m, quarter.y_m, quarter.theta_rad) == pytest.approx((1.0, 1.0, math.pi / 2))
    assert arc(0.7, 0.0) == Pose2(0.7, 0.0, 0.0)


@given(v=st.floats(-0.5, 0.5), w=st.floats(-0.6, 0.6))
def test_an_increment_tells_its_mean_twist(config: Config, v: float, w: float) -> None:
    left, right = wheels_from_twist(config.base, v, w)
    found = drive(WheelOdometry(config.base), [(left * 0.01, right * 0.01)])
    assert found.twist == pytest.approx((v, w), abs=1e-9)


def test_a_full_circle_comes_back(config: Config) -> None:
    base = config.base
    left, right = wheels_from_twist(base, 0.3, 0.5)
    count = round(2 * math.pi / 0.5 / 0.01)
    scale = 2 * math.pi / (count * 0.5)
    total = drive(WheelOdometry(base), [(left * scale, right * scale)] * count)
    assert math.hypot(total.pose.x_m, total.pose.y_m) < 1e-9
    assert abs(total.pose.theta_rad) < 1e-9
    assert total.duration_ns == count * STEP_NS


def sampled(config: Config, noise: WheelNoise, steps: list[tuple[float, float]], runs: int) -> Array:
    """Poses (runs, 3) at the end of noisy ways, integrated without the class under test."""
    random = np.random.default_rng(7)
    base = config.base
    pose = np.zeros((runs, 3))
    for step in steps:
        ways = [turned * base.wheel_radius_m for turned in step]
        left, right = (way + random.normal(0, math.sqrt(noise.slip_m * abs(way)), runs) for way in ways)
        side = random.normal(0, math.sqrt(noise.side_slip_m * abs(sum(ways) / 2)), runs)
        turn, way = (right - left) / base.track_m, (left + right) / 2
        middle = pose[:, 2] + turn / 2
        pose[:, 0] += way * np.cos(middle) - side * np.sin(middle)
        pose[:, 1] += way * np.sin(middle) + side * np.cos(middle)
        pose[:, 2] += turn
    return pose


@pytest.mark.parametrize(("v", "w"), [(0.3, 0.0), (0.3, 0.4), (0.2, -0.6), (-0.1, 0.2)])
def test_the_covariance_is_that_of_many_noisy_ways(config: Config, v: float, w: float) -> None:
    noise = WheelNoise(slip_m=2e-4, side_slip_m=1e-4, angle_rad=0.0)
    left, right = wheels_from_twist(config.base, v, w)
    steps = [(left * 0.01, right * 0.01)] * 300
    total = drive(WheelOdometry(config.base, noise), steps)
    poses = sampled(config, noise, steps, 4000)
    found = np.cov(poses.T)
    scale = np.sqrt(np.diag(found))
    assert poses.mean(axis=0) == pytest.approx(total.pose.as_array(), abs=float(0.1 * scale.max()))
    assert total.covariance / np.outer(scale, scale) == pytest.approx(found / np.outer(scale, scale), abs=0.08)


def test_a_gap_keeps_the_way_and_widens_the_covariance_by_where_the_turn_may_have_been(config: Config) -> None:
    base = config.base
    left, right = wheels_from_twist(base, 0.3, 0.5)
    dense = drive(WheelOdometry(base), [(left * 0.01, right * 0.01)] * 40)
    odometry = WheelOdometry(base)
    odometry.advance(0, (0.0, 0.0))
    sparse = increment(odometry.advance(40 * STEP_NS, (left * 0.4, right * 0.4)))
    assert sparse.gap
    assert not dense.gap
    assert sparse.pose.as_array() == pytest.approx(dense.pose.as_array(), abs=1e-9)
    # the same wheel angles with all the turn at the start or at the end
    way, turn = path_from_wheels(base, (left * 0.4, right * 0.4))
    early = arc(0.0, turn).compose(arc(way, 0.0))
    assert abs(early.y_m - sparse.pose.y_m) < 2 * math.sqrt(sparse.covariance[1, 1])
    assert sparse.covariance[1, 1] > 4 * dense.covariance[1, 1]


def test_old_and_impossible_measurements_make_no_increment(config: Config) -> None:
    odometry = WheelOdometry(config.base)
    assert odometry.advance(STEP_NS, (1.0, 1.0)) == "first"
    assert odometry.advance(STEP_NS, (1.1, 1.1)) == "repeated"
    assert odometry.advance(2 * STEP_NS, (9.0, 1.0)) == "jump"
    following = increment(odometry.advance(3 * STEP_NS, (9.01, 1.01)))
    assert following.pose.x_m == pytest.approx(0.01 * config.base.wheel_radius_m)
    assert odometry.advance(4 * STEP_NS, (math.nan, 1.0)) == "jump"
    assert odometry.advance(5 * STEP_NS, (9.0, 1.0)) == "first"


@given(turned=st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1)))
def test_a_covariance_is_symmetric_and_positive(config: Config, turned: tuple[float, float]) -> None:
    total = drive(WheelOdometry(config.base), [turned] * 3)
    assert total.covariance == pytest.approx(total.covariance.T)
    assert np.linalg.eigvalsh(total.covariance).min() >= -1e-15
