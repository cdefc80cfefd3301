"""``davpc can`` on a simulated bus in stepped time."""

from __future__ import annotations

import pytest

from common.errors import DeviceError
from sim.can.drive_402 import Drive402
from sim.can.faults import EncoderFault
from station.commission.can_tools import Monitor, follower_names, scan
from station.commission.enable_test import Check, EnableTest
from tests.rigs.canbus_rig import CONFIG_PATH, Rig, RigClock, Tap, follower_rig, wheel_surface_speed


def test_scan_finds_every_node_by_name() -> None:
    with follower_rig() as rig:
        found = scan(rig.config.follower_can.bus, follower_names(rig.config, CONFIG_PATH))
        assert [node.node_id for node in found] == [1, 2, 11, 12, 13, 14, 21, 22, 23, 24, 30, 40]
        assert (found[0].name, found[0].profile, found[0].product) == ("left wheel", "drive", 0x402)
        assert (found[-1].name, found[-1].profile, found[-1].product) == ("follower I/O", "I/O module", 0x401)
        assert not any(drive.enabled for drive in rig.robot.drives)


def test_scan_of_an_empty_bus_finds_nothing() -> None:
    with follower_rig() as rig:
        rig.robot.bus.faults.silent.update(range(128))
        assert scan(rig.config.follower_can.bus, {}) == []


def test_monitor_follows_a_bridge_and_sends_nothing() -> None:
    with follower_rig() as rig:
        rig.enable()
        rig.cycles(80, wheel_surface_speed(0.2, rig.config))
        monitor = Monitor(rig.config, CONFIG_PATH)
        monitor.open()
        tap = Tap(rig)
        for _ in range(5):
            rig.cycle(wheel_surface_speed(0.2, rig.config))
            tap.read()
            rows, measured = monitor.poll(rig.clock.now_ns())
            assert tap.read() == []
        tap.close()
        assert (rows[0].name, rows[0].state) == ("left wheel", "operation enabled")
        assert rows[0].velocity * rig.config.base.wheel_radius_m == pytest.approx(0.2, rel=1e-3)
        assert rows[0].age_ms == 0.0
        assert measured.troubles == ()
        rig.robot.left_wheel.trip(0x2310)
        rig.cycle()
        rows, _ = monitor.poll(rig.clock.now_ns())
        assert rows[0].faults == ("left wheel: continuous over-current (EMCY 2310h)",)
        monitor.close()
        assert rig.cycle().bus_ok


def _lift_follows(rig: Rig) -> None:
    lift = rig.robot.lift
    moved = lift.moved

    def follow(elapsed_s: float) -> None:
        moved(elapsed_s)
        if lift.enabled:
            lift.set_measured(lift.position_setpoint, 0.0, 0.0)

    lift.__dict__["moved"] = follow


def _arms_follow(rig: Rig, stuck: int, weak: int) -> None:
    """Joints and fingers speed up by their torque; fingers close by a positive one."""
    for n, drive in enumerate((*rig.robot.joints, *rig.robot.grippers)):
        _turn(drive, 0.0 if n == stuck else 5.0 if n < 6 else -5.0, 0.5 if n == weak else 1.0)


def _turn(drive: Drive402, speed_per_n_m: float, gives: float) -> None:
    moved = drive.moved
    place = [0.5]

    def follow(elapsed_s: float) -> None:
        moved(elapsed_s)
        torque = gives * drive.torque_setpoint_n_m if drive.effort == "torque" else 0.0
        place[0] += speed_per_n_m * torque * elapsed_s
        drive.set_measured(place[0], 0.0, torque)

    drive.__dict__["moved"] = follow


def _run(rig: Rig, stuck: int = -1, weak: int = -1) -> list[Check]:
    _lift_follows(rig)
    _arms_follow(rig, stuck, weak)
    return list(EnableTest(rig.config, CONFIG_PATH, RigClock(rig)).run())


def test_enable_test_passes_on_a_healthy_robot() -> None:
    with follower_rig() as rig:
        checks = _run(rig)
        assert [check for check in checks if not check.passed] == []
        assert len(checks) == 1 + 4 + 1 + 8 * 3 + 2 + 1
        assert "commanded 1.0, measured 0.600 m/s" in checks[5].result
        assert checks[-1].name == "watchdog"
        assert not rig.robot.left_wheel.enabled


def test_enable_test_ends_at_a_wheel_that_turns_the_wrong_way() -> None:
    with follower_rig() as rig:
        rig.robot.right_wheel.encoder = EncoderFault(inverted=True)
        checks = _run(rig)
        assert (checks[-1].name, checks[-1].passed) == ("right wheel forward", False)
        assert "right -0.100 m/s" in checks[-1].result


def test_enable_test_ends_at_a_joint_that_turns_the_wrong_way() -> None:
    with follower_rig() as rig:
        rig.robot.joints[4].encoder = EncoderFault(inverted=True)
        checks = _run(rig)
        assert (checks[-1].name, checks[-1].passed) == ("right joint 2 +", False)


def test_enable_test_ends_at_a_joint_that_does_not_move() -> None:
    with follower_rig() as rig:
        checks = _run(rig, stuck=1)
        assert (checks[-1].name, checks[-1].passed) == ("left joint 2 moves", False)
        assert "in neither direction" in checks[-1].result


def test_enable_test_ends_at_a_joint_that_does_not_give_its_torque() -> None:
    with follower_rig() as rig:
        checks = _run(rig, weak=0)
        assert (checks[-1].name, checks[-1].passed) == ("left joint 1 +", False)


def test_enable_test_names_what_is_missing() -> None:
    with follower_rig() as rig:
        rig.robot.bus.faults.silent.add(30)
        with pytest.raises(DeviceError, match=r"node 30 \(lift\)"):
            _run(rig)
