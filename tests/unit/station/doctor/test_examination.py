"""What ``davpc doctor`` examines."""

from __future__ import annotations

from station.doctor.examination import default_robots


def test_whose_parts() -> None:
    assert default_robots(None) == ("follower", "leader")
    assert default_robots(("leader", "hardware")) == ("leader",)
    assert default_robots(("leader", "simulated")) == ("follower", "leader")
