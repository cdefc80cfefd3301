"""Bridge against simulated drives in stepped time: the same bytes, the same state machines as on the robot."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest

from common.canopen.bus import CanBus
from common.canopen.cia402 import DriveState
from common.canopen.frames import heartbeat_frame
from common.config import BusConfig
from common.errors import ConfigError, DeviceError
from common.timing import NS_PER_S
from follower.can_bridge.drive_bus import DriveBus
from follower.can_bridge.measurement import DriveSetpoint
from tests.rigs.canbus_rig import (
    CONFIG_PATH,
    DRIVE_EDS,
    follower_rig,
    rig_with,
    stepped_config,
    wheel_surface_speed,
)


def test_enables_drives_and_quick_stops() -> None:
    with follower_rig() as rig:
        measured = rig.enable()
        assert measured.troubles == ()
        assert measured.wheels_enabled
        assert measured.arms_enabled
        setpoint = wheel_surface_speed(0.3, rig.config)
        measured = rig.cycles(120, setpoint)
        assert measured.wheel_speed_rad_s == pytest.approx((0.3 / 0.085, 0.3 / 0.085), rel=1e-3)
        assert measured.wheel_angle_rad[0] > 2.0
        assert measured.wheel_angle_rad == pytest.approx((measured.wheel_angle_rad[0],) * 2)
        rig.drives.quick_stop()
        measured = rig.cycles(3, setpoint)
        assert set(measured.states[:2]) == {DriveState.QUICK_STOP}
        # 0.3 m/s at the drives' own 0.5 m/s²: 0.6 s, then the wheels switch themselves off
        measured = rig.cycles(57, setpoint)
        assert set(measured.states[:2]) == {DriveState.QUICK_STOP}
        measured = rig.cycles(6, setpoint)
        assert set(measured.states[:2]) == {DriveState.SWITCH_ON_DISABLED}
        assert measured.wheel_speed_rad_s == (0.0, 0.0)
        assert set(measured.states[2:]) == {DriveState.QUICK_STOP}


def test_no_gripper_is_in_operation_without_its_torque() -> None:
    with follower_rig() as rig:
        rig.enable()
        setpoint = DriveSetpoint(grip_torque_n_m=(2.0, 2.0))
        rig.cycles(5, setpoint)
        for _ in range(3):
            rig.drives.quick_stop(("arms",))
            rig.cycles(5)
            assert {gripper.effort for gripper in rig.robot.grippers} == {"position"}
            rig.drives.enable()
            for _ in range(5):
                rig.cycle(setpoint)
                for gripper in rig.robot.grippers:
                    assert gripper.effort == "position" or gripper.torque_setpoint_n_m == pytest.approx(2.0, abs=0.01)
            assert {gripper.effort for gripper in rig.robot.grippers} == {"torque"}


def test_signs_and_ratios_hold_on_each_axis() -> None:
    with follower_rig() as rig:
        rig.robot.lift.set_measured(0.1, 0.0, 0.0)
        for n, drive in enumerate((*rig.robot.joints, *rig.robot.grippers)):
            drive.set_measured(0.1 * n, 0.0, 0.5 * n)
        rig.enable()
        torques = (1.0, -2.0, 3.0, -4.0, 5.0, -6.0)
        measured = rig.cycles(
            50,
            DriveSetpoint(
                left_rad_s=0.0, right_rad_s=0.0, joint_torque_n_m=torques, grip_torque_n_m=(2.0, -1.5), lift_m=0.12
            ),
        )
        assert measured.joint_angle_rad == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4, 0.5], abs=1e-4)
        assert measured.joint_torque_n_m == pytest.approx([0.0, 0.5, 1.0, 1.5, 2.0, 2.5], abs=0.02)
        assert measured.grip_angle_rad == pytest.approx((0.6, 0.7), abs=1e-4)
        assert [d.torque_setpoint_n_m for d in rig.robot.joints] == pytest.approx(torques, abs=0.02)
        assert [d.torque_setpoint_n_m for d in rig.robot.grippers] == pytest.approx((2.0, -1.5), abs=0.01)
        assert {d.effort for d in rig.robot.joints} == {"torque"}
        rig.cycles(80, DriveSetpoint(lift_m=0.12))
        assert rig.robot.lift.position_setpoint == pytest.approx(0.12, abs=1e-5)


def test_lift_takes_a_second_setpoint() -> None:
    with follower_rig() as rig:
        rig.enable()
        rig.cycles(30, DriveSetpoint(lift_m=0.005))
        rig.cycles(60, DriveSetpoint(lift_m=0.010))
        assert rig.robot.lift.position_setpoint == pytest.approx(0.010, abs=1e-6)


def test_drives_stop_by_themselves_when_the_bridge_is_silent() -> None:
    with follower_rig() as rig:
        rig.enable()
        setpoint = wheel_surface_speed(0.3, rig.config)
        rig.cycles(100, setpoint)
        rig.pass_time(68)  # 10 ms of the last cycle have passed already
        assert rig.robot.left_wheel.enabled
        rig.pass_time(6)
        assert rig.robot.left_wheel.state.value == 0x07
        assert {joint.effort for joint in rig.robot.joints} == {"position"}
        rig.pass_time(700)
        measured = rig.cycles(20, setpoint)
        assert (measured.faults, measured.silent) == ((), ())
        assert "bridge: stalled for 7" in measured.stalled
        assert rig.robot.left_wheel.state.value == 0x40
        assert rig.robot.left_wheel.velocity_setpoint_rad_s == 0.0
        rig.drives.disable()
        assert rig.cycles(2).stalled == ""
        rig.drives.enable()
        assert rig.cycles(8).wheels_enabled


def test_a_fault_of_a_drive_is_reported_during_a_stall_of_the_bridge() -> None:
    with follower_rig() as rig:
        rig.enable()
        rig.robot.joints[0].trip(0x2310)
        rig.pass_time(200)
        measured = rig.cycles(3)
        assert measured.stalled
        assert measured.faults == ("left joint 1: continuous over-current (EMCY 2310h)",)


def test_silent_module_means_stop() -> None:
    with follower_rig() as rig:
        measured = rig.enable()
        assert measured.estop_clear
        assert measured.battery_v == pytest.approx(26.0)
        rig.robot.set_stop_inputs(estop_clear=False, protective_clear=True)
        measured = rig.cycles(2)
        assert (measured.estop_clear, measured.protective_clear) == (False, True)


def test_bring_up_names_the_missing_node() -> None:
    with follower_rig() as rig:
        rig.robot.joints[2].node_id = 99
        rig.robot.joints[2]._sdo.tx_cobid = 0x580 + 99
        with pytest.raises(DeviceError, match=r"node 13 \(left joint 3\): object 1000h:00: read: no answer"):
            rig.drives.open()
        assert not any(drive.enabled for drive in rig.robot.drives)


class _LateTap(CanBus):
    """A bus on which another master's heartbeat comes while it is being opened."""

    def __init__(self, config: BusConfig) -> None:
        super().__init__(config)
        other = CanBus(config)
        other.send(heartbeat_frame(127, 0x05))
        other.close()


def test_a_bus_with_another_active_master_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    with follower_rig() as rig:
        rig.enable()
        rolling = wheel_surface_speed(0.2, rig.config)
        rig.cycles(80, rolling)
        second = DriveBus(rig.config.follower_can, rig.config.base, CONFIG_PATH)
        monkeypatch.setattr("follower.can_bridge.drive_bus.CanBus", _LateTap)
        with pytest.raises(DeviceError, match=r"another master is active on it \(heartbeat of node 127\): stop its"):
            second.open()
        measured = rig.cycles(5, rolling)
        assert measured.faults == ()
        assert measured.wheels_enabled


def test_another_device_is_refused_by_name() -> None:
    with follower_rig() as rig:
        rig.robot.right_wheel.values[0x1018, 2] = 0x999
        with pytest.raises(DeviceError, match=r"node 2 \(right wheel\): object 1018h:02: product is 2457"):
            rig.drives.open()


def test_stopped_within_an_exchange_it_does_not_send_the_rest_of_it_later() -> None:
    with follower_rig() as rig:
        rig.enable()
        setpoint = wheel_surface_speed(0.3, rig.config)
        rig.cycles(100, setpoint)
        late_ns = iter((0, *[10 * NS_PER_S] * 100))
        now_ns = rig.clock.now_ns()
        drives = rig.drives
        drives._clock_ns = lambda: now_ns + next(late_ns)  # it is stopped behind the first wheel's frame
        measured = drives.exchange(now_ns, setpoint)
        assert measured.stalled == "bridge: stalled for 10000 ms"
        rig.pass_time(10)
        assert rig.robot.right_wheel.state.value == 0x07
        drives.exchange(rig.clock.now_ns(), setpoint)
        rig.pass_time(10)
        assert rig.robot.left_wheel.state.value == 0x07


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, r"EDS file 'mine.eds' is not beside it"),
        ("hello", r"mine.eds: not an EDS: File contains no section headers"),
        ("[DeviceInfo]\nVendorNumber=1\n", r"mine.eds: not an EDS: it describes no object"),
    ],
)
def test_a_wrong_eds_is_one_clear_line(tmp_path: Path, text: str | None, message: str) -> None:
    if text is not None:
        (tmp_path / "mine.eds").write_text(text)
    config = stepped_config()
    changed = config.follower_can.model_copy(update={"drive_eds": "mine.eds"})
    with follower_rig() as rig, pytest.raises(ConfigError, match=message) as raised:
        DriveBus(changed, config.base, tmp_path / "robots.toml").open()
    assert "\n" not in str(raised.value)
    assert not any(drive.enabled for drive in rig.robot.drives)


def test_an_eds_without_a_needed_object_is_named(tmp_path: Path) -> None:
    lines = DRIVE_EDS.read_text().replace("[605A]", "[2605A]").replace("=0x605A", "=0x2605")
    (tmp_path / "mine.eds").write_text(lines.replace("[2605A]", "[2605]"))
    config = stepped_config()
    changed = config.follower_can.model_copy(update={"drive_eds": "mine.eds"})
    with follower_rig(), pytest.raises(DeviceError, match=r"mine.eds: no object 605Ah:00, needed by left wheel"):
        DriveBus(changed, config.base, tmp_path / "robots.toml").open()


def test_a_value_that_the_node_does_not_keep_is_named() -> None:
    with follower_rig() as rig:
        joint = rig.robot.joints[0]
        joint.__dict__["written"] = lambda _key: joint.values.update({(0x6007, 0): 1})
        with pytest.raises(
            DeviceError, match=r"node 11 \(left joint 1\): object 6007h:00: wrote 3, the node keeps 1"
        ):
            rig.drives.open()


def test_a_serial_number_pins_the_device() -> None:
    with follower_rig() as rig:
        wheel = rig.config.follower_can.left_wheel.model_copy(update={"serial": 4711})
        changed = rig.config.follower_can.model_copy(update={"left_wheel": wheel})
        with pytest.raises(DeviceError, match=r"node 1 \(left wheel\): object 1018h:04: serial number is 0"):
            DriveBus(changed, rig.config.base, CONFIG_PATH).open()


def test_no_server_is_one_clear_line() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        host, port = server.getsockname()
    config = stepped_config()
    bus = BusConfig(interface="socketcand", channel="follower", host=host, port=port)
    drives = DriveBus(config.follower_can.model_copy(update={"bus": bus}), config.base, CONFIG_PATH)
    with pytest.raises(DeviceError, match=rf"CAN bus follower \(socketcand at {host}:{port}\): no socketcand server"):
        drives.open()
    measured = drives.exchange(1, DriveSetpoint())
    assert (measured.bus_ok, measured.bus_lost, measured.faults) == (False, "CAN bus follower: not open", ())


def test_absolute_encoders_count_from_the_configured_zero_and_past_their_end() -> None:
    config = stepped_config()
    zero = 2**31 - 1000
    lift = config.follower_can.lift.model_copy(update={"zero_counts": -5000})
    left = config.follower_can.left_wheel.model_copy(update={"zero_counts": zero})
    changed = config.follower_can.model_copy(update={"lift": lift, "left_wheel": left})
    with rig_with(changed) as rig:
        rig.robot.lift.set_measured(0.05, 0.0, 0.0)
        rig.enable()
        measured = rig.cycles(60, DriveSetpoint(left_rad_s=2.0, lift_m=0.06))
        assert measured.lift_m == pytest.approx(0.05, abs=1e-6)
        assert rig.robot.lift.position_setpoint == pytest.approx(0.06, abs=1e-6)
        assert rig.robot.left_wheel.values[0x6064, 0] < 0
        assert 0.1 < measured.wheel_angle_rad[0] < 1.2


@pytest.mark.parametrize("stall_ms", [90, 120, 200, 400])
def test_a_stall_of_the_bridge_is_no_drive_fault(stall_ms: int) -> None:
    """The heartbeat emergencies that it causes are excused, whichever node reports them: the I/O module too."""
    with follower_rig() as rig:
        rig.enable()
        rolling = wheel_surface_speed(0.3, rig.config)
        rig.cycles(100, rolling)
        rig.pass_time(stall_ms)
        for _ in range(5):
            measured = rig.cycle(rolling)
            assert (measured.faults, bool(measured.stalled)) == ((), True)
        assert rig.drives._inbound.io.emergency is None or rig.drives._inbound.io.emergency.code == 0x8130
        rig.drives.disable()
        assert rig.cycles(20).troubles == ()
