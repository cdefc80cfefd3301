"""Collision: what it is, and what it is not."""

from __future__ import annotations

from common.config import Config
from follower.arms.collision_detection import CollisionDetector
from tests.rigs.arms_rig import DT_S, tick


def test_a_collision_is_two_samples_over_the_limit_or_a_fast_rise(config: Config) -> None:
    limit, rate = config.arms.collision_torque_n_m, config.arms.collision_rate_n_m_s
    one = CollisionDetector(config.arms)
    slow = [limit * i / 100 for i in range(100)]
    assert not any(one.step((torque, *[0.0] * 5), tick().end_ns) for torque in slow)
    assert not one.step((0.0, limit + 0.1, *[0.0] * 4), tick(20).end_ns)
    assert not one.step((0.0, limit - 0.1, *[0.0] * 4), tick().end_ns)
    assert not one.step((0.0, -limit - 0.1 + 2 * limit + 0.2, *[0.0] * 4), tick().end_ns)
    assert one.step((0.0, limit + 0.1, *[0.0] * 4), tick().end_ns)
    two = CollisionDetector(config.arms)
    assert not any(two.step((0.0,) * 6, tick().end_ns) for _ in range(10))
    rising = [two.step((*[0.0] * 5, -1.5 * rate * DT_S * i), tick().end_ns) for i in range(1, 5)]
    assert rising == [False, False, False, True]
    # as when casters swing round
    assert not any(two.step((*[0.0] * 5, -6.0 * rate * DT_S), tick().end_ns) for _ in range(9))
    once = [6.0, 8.5, 8.5, 11.5, 11.5, 11.5, 11.5]
    assert not any(two.step((*[0.0] * 5, -share * rate * DT_S), tick().end_ns) for share in once)
    two.forget()
    assert not two.step((*[0.0] * 5, 0.9 * limit), tick().end_ns)
