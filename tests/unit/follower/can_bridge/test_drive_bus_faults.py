"""Each fault that the simulated bus can have ends in the reaction that docs/safety.md names, in its time."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from common.canopen.cia402 import DriveState
from common.canopen.frames import CanFrame, nmt_frame
from common.errors import DeviceError
from common.timing import NS_PER_MS
from sim.can.faults import EncoderFault
from sim.can.power_states import PowerState
from tests.rigs.canbus_rig import Rig, follower_rig, wheel_surface_speed
from tests.rigs.driving_rig import Driving


@pytest.fixture
def driving() -> Iterator[Driving]:
    with follower_rig() as rig:
        under_way = Driving(rig)
        yield under_way
        under_way.tap.close()


def _trip(rig: Rig) -> None:
    rig.robot.left_wheel.trip(0x2310)


def _trip_joint(rig: Rig) -> None:
    rig.robot.joints[4].trip(0x7305)


def _sag(rig: Rig) -> None:
    rig.robot.right_wheel.voltage_v = 12.0


def _silence(rig: Rig) -> None:
    rig.robot.bus.faults.silent.add(2)


def _silence_module(rig: Rig) -> None:
    rig.robot.bus.faults.silent.add(rig.robot.io.node_id)


def _truncate(rig: Rig) -> None:
    rig.robot.bus.faults.truncated.add(1)


def _replay(rig: Rig) -> None:
    rig.robot.bus.faults.replayed.add(1)


def _press_estop(rig: Rig) -> None:
    rig.robot.set_stop_inputs(estop_clear=False, protective_clear=True)


def _enter_protective_field(rig: Rig) -> None:
    rig.robot.set_stop_inputs(estop_clear=True, protective_clear=False)


def _jump(rig: Rig) -> None:
    rig.robot.left_wheel.encoder = EncoderFault(jump=0.7)


def _race(rig: Rig) -> None:
    rig.robot.left_wheel.encoder = EncoderFault(stuck_at=40.0)


def _stick(rig: Rig) -> None:
    rig.robot.left_wheel.encoder = EncoderFault(stuck_at=0.0)


def _invert(rig: Rig) -> None:
    rig.robot.right_wheel.encoder = EncoderFault(inverted=True)


def _go_off(rig: Rig) -> None:
    rig.robot.left_wheel.state = PowerState.SWITCH_ON_DISABLED


FAULTS: tuple[tuple[Callable[[Rig], None], float, str, str], ...] = (
    (_trip, 20, "left wheel: continuous over-current (EMCY 2310h)", ""),
    (_trip_joint, 20, "right joint 2: incremental encoder fault (EMCY 7305h)", ""),
    (_sag, 20, "right wheel: under-voltage of the DC link (EMCY 3220h)", ""),
    (_silence, 100, "right wheel: node 2 is silent", "status_age"),
    (_silence_module, 100, "follower I/O: node 40 is silent", "stop_input"),
    (_truncate, 100, "cannot be genuine", ""),
    (_replay, 100, "cannot be genuine", ""),
    (_press_estop, 50, "", "stop_input"),
    (_enter_protective_field, 50, "", "stop_input"),
    (_jump, 100, "", "measured_jump"),
    (_race, 100, "", "measured_jump"),
    (_stick, 100, "", "measured_gap"),
    (_invert, 100, "", "measured_jump"),
    (_go_off, 20, "left wheel: left operation by itself: switch on disabled", ""),
)


@pytest.mark.parametrize(("fault", "limit_ms", "cause", "rule"), FAULTS)
def test_each_fault_stops_both_wheels(
    driving: Driving, fault: Callable[[Rig], None], limit_ms: float, cause: str, rule: str
) -> None:
    fault(driving.rig)
    took_ms, measured = driving.stop_ms()
    assert took_ms <= limit_ms
    assert any(cause in found for found in measured.troubles) or (not cause and not measured.troubles)
    assert driving.decision.rule == rule or not rule or measured.troubles


@pytest.mark.parametrize("fault", [_stick, _invert])
@pytest.mark.parametrize("speed_m_s", [0.03, 0.1])
def test_an_encoder_that_lies_at_docking_speed_stops_both_wheels(
    fault: Callable[[Rig], None], speed_m_s: float
) -> None:
    with follower_rig() as rig:
        driving = Driving(rig, speed_m_s)
        fault(rig)
        took_ms, _ = driving.stop_ms(within=60)
        assert took_ms <= 340
        assert driving.decision.rule in ("measured_stuck", "measured_gap", "measured_angle")
        driving.tap.close()


def test_a_stuck_encoder_from_standstill_stops_it() -> None:
    with follower_rig() as rig:
        rig.robot.left_wheel.encoder = EncoderFault(stuck_at=0.0)
        with pytest.raises(AssertionError):
            Driving(rig)
        assert rig.robot.left_wheel.velocity_setpoint_rad_s * rig.config.base.wheel_radius_m < 0.2


def test_bus_off_loses_the_bus_and_it_comes_back_disabled(driving: Driving) -> None:
    rig = driving.rig
    rig.robot.bus.faults.bus_off = True
    for _ in range(20):
        driving.step()
    assert not driving.measured.bus_ok
    assert driving.measured.bus_lost == "CAN bus follower (stepped): bus-off"
    assert rig.robot.left_wheel.state == PowerState.QUICK_STOP_ACTIVE
    with pytest.raises(DeviceError, match="bus-off"):
        rig.drives.open()
    rig.robot.bus.faults.bus_off = False
    rig.drives.open()
    measured = rig.cycles(10, wheel_surface_speed(0.3, rig.config))
    assert measured.bus_ok
    assert measured.states[0] is not DriveState.ENABLED
    assert not rig.robot.left_wheel.enabled or rig.robot.left_wheel.state == PowerState.QUICK_STOP_ACTIVE


def test_a_restarted_node_is_brought_up_again(driving: Driving) -> None:
    rig = driving.rig
    rig.robot.bus.faults.injected += rig.robot.left_wheel.handle(nmt_frame(0x81, 1), rig.clock.now_ns())
    driving.step()
    driving.step()
    assert "left wheel: node 1 restarted and has lost its configuration" in driving.measured.faults
    assert not driving.measured.bus_ok
    rig.pass_time(1000)
    assert rig.robot.left_wheel.velocity_setpoint_rad_s == 0.0
    assert rig.enable().wheels_enabled


def test_a_fault_stays_until_it_is_reset(driving: Driving) -> None:
    rig = driving.rig
    rig.robot.left_wheel.trip(0x2310)
    rig.cycles(120)
    rig.drives.enable()
    measured = rig.cycles(20)
    assert measured.states[0] is DriveState.FAULT
    assert not measured.wheels_enabled
    rig.drives.reset_faults()
    rig.cycles(5)
    rig.drives.enable()
    assert rig.cycles(10).troubles == ()
    assert rig.cycles(2).wheels_enabled


def test_a_drive_that_was_silent_needs_no_reset(driving: Driving) -> None:
    rig, silent = driving.rig, driving.rig.robot.bus.faults.silent
    silent.add(2)
    measured = rig.cycles(8)
    assert (measured.faults, measured.silent) == ((), ("right wheel: node 2 is silent",))
    silent.clear()
    measured = rig.cycles(10)
    assert measured.troubles == ()
    assert not measured.wheels_enabled
    rig.drives.disable()
    rig.cycles(100)
    rig.drives.enable()
    assert rig.cycles(10).wheels_enabled


def test_with_every_node_the_stop_inputs_are_silent_too_and_count_as_stop(driving: Driving) -> None:
    driving.rig.robot.bus.faults.silent.update(node.node_id for node in driving.rig.robot.bus.nodes)
    measured = driving.rig.cycles(8)
    assert (measured.faults, len(measured.silent), measured.inputs_fresh) == ((), 11, False)


@pytest.mark.parametrize("known", [True, False])
def test_a_drive_that_stood_still_itself_does_not_take_that_for_silence(driving: Driving, known: bool) -> None:
    rig = driving.rig
    rig.clock.advance_to(rig.clock.now_ns() + 200 * NS_PER_MS)
    if known:
        rig.robot.bus.excuse_stall(200 * NS_PER_MS)
    rig.robot.left_wheel.advance(rig.clock.now_ns())
    assert rig.robot.left_wheel.heartbeat_lost is not known


def test_foreign_frames_are_counted_and_change_nothing(driving: Driving) -> None:
    driving.rig.robot.bus.faults.injected += [
        CanFrame(0x7E5, bytes(8)),
        CanFrame(0x205, bytes(8)),
        CanFrame(0x1A5, b""),
        CanFrame(0x581, bytes(8)),
    ]
    driving.step()
    driving.step()
    assert driving.measured.unknown == 4
    assert driving.measured.troubles == ()
    assert driving.decision.v_m_s == 0.3
