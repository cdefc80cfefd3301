"""The Leader's I/O module against a simulated one: LEDs, actuator, switches, and a restart."""

from __future__ import annotations

import pytest

from common.canopen.bus import BusLostError
from common.canopen.frames import nmt_frame
from common.errors import ConfigError
from common.timing import NS_PER_MS
from leader.io_module import LeaderIo
from tests.rigs.canbus_rig import (
    CONFIG_PATH,
    leader_rig,
    stepped_config,
)


def test_leader_module_lights_leds_and_keeps_them_on_silence() -> None:
    with leader_rig() as (config, leader, channel, clock):
        io = LeaderIo(config.leader_can, CONFIG_PATH, leds=4)
        io.open()
        io.set_led_currents([1.0, 1.0, 0.5, 0.0])
        io.drive_actuator(1)
        for _ in range(3):
            leader.set_switches(True, False, False, True)
            leader.set_led_current(2, leader.led_setpoint_a(2))
            inputs = io.exchange(clock.now_ns())
            clock.advance_to(clock.now_ns() + 20 * NS_PER_MS)
            channel.tick()
        assert inputs.fresh
        assert inputs.led_current_a == (0.0, 0.0, 0.5, 0.0)
        assert (inputs.guide_lifted, inputs.beam_seated, inputs.lock_retracted) == (True, False, True)
        assert leader.actuator == 1
        clock.advance_to(clock.now_ns() + 250 * NS_PER_MS)
        channel.tick()
        assert leader.actuator == 0
        assert leader.led_setpoint_a(0) == 1.0


def test_leader_module_that_restarts_has_to_be_opened_again() -> None:
    with leader_rig() as (config, leader, channel, clock):
        io = LeaderIo(config.leader_can, CONFIG_PATH, leds=4)
        with pytest.raises(BusLostError, match="not open"):
            io.exchange(clock.now_ns())
        io.open()
        assert not io.exchange(clock.now_ns()).fresh
        leader.bus.faults.injected += leader.io.handle(nmt_frame(0x81), clock.now_ns())
        channel.tick()
        with pytest.raises(BusLostError, match="leader I/O: node 50 restarted and has lost its configuration"):
            io.exchange(clock.now_ns())
        io.open()
        io.exchange(clock.now_ns())
        assert io.exchange(clock.now_ns()).fresh
        io.close()


def test_more_leds_than_the_module_drives_is_an_error_of_the_configuration() -> None:
    with pytest.raises(ConfigError, match=r"leds.positions_m: 5 LEDs, the I/O module drives 4"):
        LeaderIo(stepped_config().leader_can, CONFIG_PATH, leds=5)
