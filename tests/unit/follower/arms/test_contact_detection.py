"""Contact, connection, collision, slip: each with what it is not."""

from __future__ import annotations

import pytest

from common.config import Config
from follower.arms.contact_detection import CollisionSense, ContactSense, SlipSense
from tests.rigs.arms_rig import DT_S, GRIPPED


def feel_for(
    sense: ContactSense, force_n: float, seconds: float, acceleration: float = 0.0, expected: bool = True
) -> ContactSense:
    for _ in range(round(seconds / DT_S)):
        sense.step(force_n, acceleration, DT_S, expected=expected)
    return sense


def test_contact_lasts_and_has_hysteresis(config: Config) -> None:
    threshold = config.arms.contact_force_n
    sense = ContactSense(config.arms)
    assert not feel_for(sense, 0.9 * threshold, 3.0).contact
    assert not feel_for(sense, 2 * threshold, 0.08).contact
    assert not feel_for(sense, 0.0, 0.5).contact
    assert feel_for(sense, 1.5 * threshold, 0.5).contact
    assert feel_for(sense, 0.7 * threshold, 1.0).contact
    assert not feel_for(sense, 0.3 * threshold, 0.5).contact


def test_a_rigid_connection_takes_more_than_the_guide(config: Config) -> None:
    sense = ContactSense(config.arms)
    assert (feel_for(sense, 55.0, 1.0).contact, sense.connected) == (True, False)
    assert feel_for(sense, 100.0, 0.4).connected
    assert feel_for(sense, 60.0, 0.4).connected
    assert not feel_for(sense, 30.0, 0.4).connected


def test_contact_needs_the_visual_error_too_connection_does_not(config: Config) -> None:
    sense = ContactSense(config.arms)
    assert not feel_for(sense, 60.0, 2.0, expected=False).contact
    assert feel_for(sense, 60.0, 0.5).contact
    assert feel_for(ContactSense(config.arms), 100.0, 0.5, expected=False).connected


def test_contact_counts_from_the_learned_resistance_and_allows_for_inertia(config: Config) -> None:
    threshold, sense = config.arms.contact_force_n, ContactSense(config.arms)
    for _ in range(500):
        sense.step(12.0, 0.0, DT_S, rolling=True)
    assert sense.resistance_n == pytest.approx(12.0, abs=0.2)
    assert not feel_for(sense, threshold + 8.0, 1.0).contact
    assert feel_for(sense, threshold + 15.0, 1.0).contact
    assert not feel_for(ContactSense(config.arms), threshold + 10.0, 1.0, acceleration=0.5).contact


def test_a_resistance_that_is_learned_stays_bounded(config: Config) -> None:
    sense = ContactSense(config.arms)
    for force in [200.0] * 5 + [20.0] * 300 + [-50.0] * 300:
        sense.step(force, 0.0, DT_S, rolling=True)
        assert 0.0 <= sense.resistance_n <= config.arms.pushing_force_n


def test_a_collision_is_two_samples_over_the_limit_or_a_fast_rise(config: Config) -> None:
    limit, rate = config.arms.collision_torque_n_m, config.arms.collision_rate_n_m_s
    one = CollisionSense(config.arms)
    slow = [limit * i / 100 for i in range(100)]
    assert not any(one.step((torque, *[0.0] * 5), DT_S) for torque in slow)
    assert not one.step((0.0, limit + 0.1, *[0.0] * 4), DT_S * 20)
    assert not one.step((0.0, limit - 0.1, *[0.0] * 4), DT_S)
    assert not one.step((0.0, -limit - 0.1 + 2 * limit + 0.2, *[0.0] * 4), DT_S)
    assert one.step((0.0, limit + 0.1, *[0.0] * 4), DT_S)
    two = CollisionSense(config.arms)
    assert not any(two.step((0.0,) * 6, DT_S) for _ in range(10))
    rising = [two.step((*[0.0] * 5, -1.5 * rate * DT_S * i), DT_S) for i in range(1, 5)]
    assert rising == [False, False, False, True]
    # as when casters swing round
    assert not any(two.step((*[0.0] * 5, -6.0 * rate * DT_S), DT_S) for _ in range(9))
    once = [6.0, 8.5, 8.5, 11.5, 11.5, 11.5, 11.5]
    assert not any(two.step((*[0.0] * 5, -share * rate * DT_S), DT_S) for share in once)
    two.forget()
    assert not two.step((*[0.0] * 5, 0.9 * limit), DT_S)


def test_a_slip_is_a_jump_of_a_finger_or_a_lost_grip_torque(config: Config) -> None:
    full = (config.arms.grip_torque_n_m,) * 2
    sense = SlipSense(config.arms)
    assert not any(sense.step(GRIPPED, (0.0, 0.0), DT_S) for _ in range(20))
    assert not sense.suspected
    assert not any(sense.step(GRIPPED, full, DT_S) for _ in range(100))
    assert sense.step((0.15, 0.15 - 1.2 * config.arms.slip_jump_rad), full, DT_S)
    sense.forget()
    assert not any(sense.step(GRIPPED, full, DT_S) for _ in range(100))
    weak = [sense.step(GRIPPED, (full[0], 0.4 * full[1]), DT_S) for _ in range(5)]
    assert (weak[0], weak[-1]) == (False, True)
