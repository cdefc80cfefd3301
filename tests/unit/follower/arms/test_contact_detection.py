"""Contact and connection: what they are, and what they are not."""

from __future__ import annotations

import pytest

from common.config import Config
from follower.arms.contact_detection import ContactDetector
from tests.rigs.arms_rig import DT_S, tick


def feel_for(
    sense: ContactDetector, force_n: float, seconds: float, acceleration: float = 0.0, expected: bool = True
) -> ContactDetector:
    for _ in range(round(seconds / DT_S)):
        sense.step(force_n, acceleration, tick(), expected=expected)
    return sense


def test_contact_lasts_and_has_hysteresis(config: Config) -> None:
    threshold = config.arms.contact_force_n
    sense = ContactDetector(config.arms)
    assert not feel_for(sense, 0.9 * threshold, 3.0).contact
    assert not feel_for(sense, 2 * threshold, 0.08).contact
    assert not feel_for(sense, 0.0, 0.5).contact
    assert feel_for(sense, 1.5 * threshold, 0.5).contact
    assert feel_for(sense, 0.7 * threshold, 1.0).contact
    assert not feel_for(sense, 0.3 * threshold, 0.5).contact


def test_a_rigid_connection_takes_more_than_the_guide(config: Config) -> None:
    sense = ContactDetector(config.arms)
    assert (feel_for(sense, 55.0, 1.0).contact, sense.connected) == (True, False)
    assert feel_for(sense, 100.0, 0.4).connected
    assert feel_for(sense, 60.0, 0.4).connected
    assert not feel_for(sense, 30.0, 0.4).connected


def test_contact_needs_the_visual_error_too_connection_does_not(config: Config) -> None:
    sense = ContactDetector(config.arms)
    assert not feel_for(sense, 60.0, 2.0, expected=False).contact
    assert feel_for(sense, 60.0, 0.5).contact
    assert feel_for(ContactDetector(config.arms), 100.0, 0.5, expected=False).connected


def test_contact_counts_from_the_learned_resistance_and_allows_for_inertia(config: Config) -> None:
    threshold, sense = config.arms.contact_force_n, ContactDetector(config.arms)
    for _ in range(500):
        sense.step(12.0, 0.0, tick(), rolling=True)
    assert sense.resistance_n == pytest.approx(12.0, abs=0.2)
    assert not feel_for(sense, threshold + 8.0, 1.0).contact
    assert feel_for(sense, threshold + 15.0, 1.0).contact
    assert not feel_for(ContactDetector(config.arms), threshold + 10.0, 1.0, acceleration=0.5).contact


def test_a_resistance_that_is_learned_stays_bounded(config: Config) -> None:
    sense = ContactDetector(config.arms)
    for force in [200.0] * 5 + [20.0] * 300 + [-50.0] * 300:
        sense.step(force, 0.0, tick(), rolling=True)
        assert 0.0 <= sense.resistance_n <= config.arms.pushing_force_n
