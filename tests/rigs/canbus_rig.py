"""A Follower's simulated bus in stepped time, wheels up: what the tests of bridge and drives share."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from common.canopen.frames import CanFrame
from common.config import Config, FollowerCanConfig, load_config
from common.timing import NS_PER_MS, SteppedClock
from follower.can_bridge.bridge import wheel_status
from follower.can_bridge.drive_bus import DriveBus
from follower.can_bridge.gate import StopInputs, WheelStatus
from follower.can_bridge.measurement import BusMeasurement, DriveSetpoint
from sim.can.nodes import FollowerBus, LeaderBus
from sim.can.stepped_bus import SteppedBus, SteppedChannel

CONFIG_PATH = Path(__file__).parents[2] / "deploy/config/robots.toml"
DRIVE_EDS = CONFIG_PATH.parent / "davpc-drive-402.eds"
IO_EDS = CONFIG_PATH.parent / "davpc-io-401.eds"


def stepped_config(*overrides: str) -> Config:
    """The reference robots on stepped buses."""
    return load_config(
        CONFIG_PATH,
        [
            'follower_can.bus={ interface = "stepped", channel = "follower" }',
            'leader_can.bus={ interface = "stepped", channel = "leader" }',
            *overrides,
        ],
    )


class Rig:
    """Bridge side and simulated side; wheels follow their set-point at once, everything else stands."""

    def __init__(self, config: Config, channel: SteppedChannel, robot: FollowerBus, clock: SteppedClock) -> None:
        self.config = config
        self.clock = clock
        self.channel = channel
        self.robot = robot
        self.drives = DriveBus(config.follower_can, config.base, CONFIG_PATH)
        self.wheels_turn = True
        self._angles = [0.0, 0.0]

    def cycle(self, setpoint: DriveSetpoint | None = None, period_ms: float = 10.0) -> BusMeasurement:
        """One exchange, then a period of the simulated world."""
        measurement = self.drives.exchange(self.clock.now_ns(), setpoint or DriveSetpoint())
        self.pass_time(period_ms)
        return measurement

    def cycles(self, count: int, setpoint: DriveSetpoint | None = None) -> BusMeasurement:
        """Several cycles; the last one's measurement."""
        for _ in range(count - 1):
            self.cycle(setpoint)
        return self.cycle(setpoint)

    def pass_time(self, milliseconds: float) -> None:
        """The world without the bridge, in steps of 2 ms."""
        end_ns = self.clock.now_ns() + round(milliseconds * NS_PER_MS)
        while self.clock.now_ns() < end_ns:
            self.clock.advance_to(min(self.clock.now_ns() + 2 * NS_PER_MS, end_ns))
            for drive in self.robot.drives:
                drive.advance(self.clock.now_ns())
            for n, wheel in enumerate((self.robot.left_wheel, self.robot.right_wheel)):
                speed = wheel.velocity_setpoint_rad_s if self.wheels_turn else 0.0
                self._angles[n] += speed * 0.002
                wheel.set_measured(self._angles[n], speed, 0.1 * speed)
            self.channel.tick()

    def enable(self) -> BusMeasurement:
        """Open, request operation and wait until every drive is in it."""
        self.drives.open()
        self.drives.enable()
        return self.cycles(8)


@contextmanager
def follower_rig() -> Iterator[Rig]:
    """A switched-on Follower and a bridge that has not opened the bus yet."""
    with rig_with(stepped_config().follower_can) as rig:
        yield rig


@contextmanager
def rig_with(follower_can: FollowerCanConfig) -> Iterator[Rig]:
    """The same with another configuration of the Follower's bus, on both sides."""
    config = stepped_config().model_copy(update={"follower_can": follower_can})
    clock = SteppedClock()
    robot = FollowerBus.build(follower_can, CONFIG_PATH)
    with SteppedChannel("follower", robot.bus, clock.now_ns) as channel:
        rig = Rig(config, channel, robot, clock)
        try:
            yield rig
        finally:
            rig.drives.close()


@contextmanager
def leader_rig() -> Iterator[tuple[Config, LeaderBus, SteppedChannel, SteppedClock]]:
    """A switched-on Leader module on a stepped bus."""
    config = stepped_config()
    clock = SteppedClock()
    leader = LeaderBus.build(config.leader_can, CONFIG_PATH)
    with SteppedChannel("leader", leader.bus, clock.now_ns) as channel:
        yield config, leader, channel, clock


def wheel_surface_speed(speed_m_s: float, config: Config) -> DriveSetpoint:
    """Both wheels at this surface speed."""
    wheel = speed_m_s / config.base.wheel_radius_m
    return DriveSetpoint(left_rad_s=wheel, right_rad_s=wheel)


def wheels_alone(measured: BusMeasurement) -> WheelStatus:
    """What the gate gets of a measurement, while only the wheels have to be enabled."""
    return replace(wheel_status(measured), drives_enabled=measured.wheels_enabled)


def stop_inputs(measured: BusMeasurement) -> StopInputs:
    """The stop inputs of a measurement."""
    return StopInputs(
        fresh=measured.inputs_fresh,
        estop_clear=measured.estop_clear,
        protective_clear=measured.protective_clear,
    )


class Tap:
    """Another client of a stepped channel: every frame on the bus, with its time."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self._bus = SteppedBus(rig.channel.name)
        self.frames: list[tuple[int, CanFrame]] = []

    def read(self) -> list[tuple[int, CanFrame]]:
        """What went over the bus since the last call, stamped with the time of this one."""
        fresh = [(self._rig.clock.now_ns(), frame) for frame in self._bus.inbox]
        self._bus.inbox.clear()
        self.frames += fresh
        return fresh

    def close(self) -> None:
        """Leave the bus."""
        self._bus.shutdown()


def is_stop(frame: CanFrame, node_id: int) -> bool:
    """An RPDO that commands quick stop or zero speed to this wheel."""
    if frame.can_id != 0x200 + node_id:
        return False
    word, velocity = int.from_bytes(frame.data[:2], "little"), int.from_bytes(frame.data[2:], "little")
    return velocity == 0 or word & 0x04 == 0


class RigClock:
    """Sleeping lets the simulated world go on."""

    boot_id = "stepped"

    def __init__(self, rig: Rig) -> None:
        self._rig = rig

    def now_ns(self) -> int:
        return self._rig.clock.now_ns()

    def sleep_until(self, deadline_ns: int) -> None:
        self._rig.pass_time((deadline_ns - self._rig.clock.now_ns()) / 1e6)
