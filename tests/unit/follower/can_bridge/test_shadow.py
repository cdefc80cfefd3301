"""Shadow: the drives are never enabled, whatever is asked."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import pytest

from common.canopen.cia402 import DriveState
from common.timing import NS_PER_MS
from follower.can_bridge.measurement import DriveSetpoint
from follower.can_bridge.shadow import Shadow
from tests.rigs.bridge_rig import HEALTHY
from tests.rigs.canbus_rig import Tap, rig_with, stepped_config, wheel_surface_speed


def test_no_frame_enables_a_drive_in_shadow() -> None:
    shadowed = stepped_config("follower_can.shadow=true").follower_can
    with rig_with(shadowed) as rig:
        rig.drives.open()
        tap = Tap(rig)
        rig.drives.enable()
        measured = rig.cycles(60, wheel_surface_speed(0.3, rig.config))
        words = {int.from_bytes(f.data[:2], "little") for _, f in tap.read() if 0x200 < f.can_id <= 0x27F}
        tap.close()
        assert measured.troubles == ()
        assert set(measured.states) == {DriveState.SWITCH_ON_DISABLED}
        assert all(word & 0x0F != 0x0F for word in words)


def test_pretended_wheels_follow_with_the_drives_ramp() -> None:
    config = stepped_config()
    shadow, radius = Shadow(config.follower_can, config.base), config.base.wheel_radius_m
    commanded = DriveSetpoint(left_rad_s=0.1 / radius, right_rad_s=-0.1 / radius)
    surfaces_m_s, angles_m = [], []
    for n in range(15):
        seen = shadow.pretend(replace(HEALTHY, now_ns=n * 10 * NS_PER_MS, wheels_enabled=False))
        surfaces_m_s.append(seen.wheel_speed_rad_s[0] * radius)
        angles_m.append(seen.wheel_angle_rad[0] * radius)
        assert seen.wheels_enabled
        assert seen.wheel_speed_rad_s[1] == pytest.approx(-seen.wheel_speed_rad_s[0])
        assert shadow.withhold(commanded) == DriveSetpoint()
    assert surfaces_m_s[0] == 0.0
    assert surfaces_m_s[2] == pytest.approx(0.02)
    assert surfaces_m_s[-1] == pytest.approx(0.1)
    speeds = pairwise(surfaces_m_s)
    assert angles_m[-1] == pytest.approx(sum(0.5 * (before + now) * 0.01 for before, now in speeds))
