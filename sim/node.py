"""World process: the plant, the simulated ends of both CAN buses, and the state that the optics render from."""

from __future__ import annotations

import socket
from collections.abc import Sequence
from contextlib import AbstractContextManager, ExitStack, nullcontext

from common.config import BusConfig
from common.errors import ConfigError, DeviceError
from common.node import Inbox, Node, NodeContext, Output, Trigger
from common.timing import NS_PER_S
from sim.can.bus import SimulatedBus
from sim.can.nodes import FollowerBus, LeaderBus
from sim.can.server import CanServer
from sim.can.stepped_bus import SteppedChannel
from sim.physics.plant import Plant
from sim.truth import true_robots
from sim.world_config import world_config
from sim.world_message import WORLD, WorldState


class WorldNode(Node):
    """One step per exposure of the camera; CAN frames in between are handled as they arrive."""

    name = "world"
    outputs = (WORLD,)

    def __init__(self, context: NodeContext) -> None:
        config = context.config
        self._world = world_config(config, str(context.config_path))
        true = true_robots(config, self._world.truth)
        self._follower = FollowerBus.build(true.follower_can, context.config_path)
        self._leader = LeaderBus.build(config.leader_can, context.config_path)
        self.plant = Plant(true, self._world, self._follower, self._leader)
        self._clock = context.clock
        self._can = (config.follower_can.bus, config.leader_can.bus)
        self._path = context.config_path
        self._lock: AbstractContextManager[object] = nullcontext()
        self._ticks: list[SteppedChannel] = []
        self._devices = ExitStack()
        self._sequence = 0
        self.trigger = Trigger(period_ns=round(NS_PER_S / config.camera.rate_hz))

    def start(self, now_ns: int) -> None:
        """Open both buses as configured: over socketcand, or stepped in this process."""
        self.plant.advance(now_ns)
        buses = dict(zip((bus.channel for bus in self._can), (self._follower.bus, self._leader.bus), strict=True))
        interfaces = {bus.interface for bus in self._can}
        if interfaces == {"stepped"}:
            self._ticks = [
                self._devices.enter_context(SteppedChannel(name, bus, self._now_ns)) for name, bus in buses.items()
            ]
        elif interfaces == {"socketcand"} and len({(bus.host, bus.port) for bus in self._can}) == 1:
            self._serve(self._can[0], buses)
        else:
            raise ConfigError(
                f"{self._path}: the simulated world needs both buses as socketcand on one port, or both as stepped"
            )

    def step(self, now_ns: int, inputs: Inbox) -> Sequence[Output]:  # noqa: ARG002 - the world takes input from CAN only
        """Advance to the exposure and publish the world's state."""
        for channel in self._ticks:
            channel.tick()
        with self._lock:
            self.plant.advance(now_ns)
            state = self._state(now_ns)
        return ((WORLD, state),)

    def stop(self, now_ns: int) -> Sequence[Output]:  # noqa: ARG002
        """Close both buses."""
        self._devices.close()
        return ()

    def _serve(self, bus: BusConfig, buses: dict[str, SimulatedBus]) -> None:
        try:
            if self._world.can_server_fd >= 0:
                listener = socket.socket(fileno=self._world.can_server_fd)
            else:
                listener = socket.create_server((bus.host, bus.port))
        except OSError as error:
            raise DeviceError(f"CAN server {bus.host}:{bus.port}: {error.strerror}") from error
        server = CanServer(listener, buses, self._clock.now_ns, before=self.plant.advance)
        server.start()
        self._lock = server.lock
        self._devices.callback(server.stop)

    def _now_ns(self) -> int:
        """The time; the plant is advanced to it."""
        now_ns = self._clock.now_ns()
        self.plant.advance(now_ns)
        return now_ns

    def _state(self, now_ns: int) -> WorldState:
        plant, handle = self.plant, self.plant.contact.handle
        self._sequence += 1
        return WorldState(
            sequence=self._sequence,
            time_ns=plant.time_ns if plant.time_ns is not None else now_ns,
            x_m=plant.pose.x_m,
            y_m=plant.pose.y_m,
            theta_rad=plant.pose.theta_rad,
            v_m_s=plant.v_m_s,
            w_rad_s=plant.w_rad_s,
            pitch_rad=plant.pitch_rad,
            roll_rad=plant.roll_rad,
            led_current_a=tuple(plant.leader.led_current_a),
            beam_x_m=plant.contact.beam_x_m,
            handle_force_n=plant.contact.handle_force_n,
            gripped=plant.contact.gripped,
            seated=plant.contact.seated,
            locked=plant.leader.locked,
            lifted=plant.contact.lifted,
            lock_travel=plant.leader.travel,
            trolley=(handle.x_m, handle.y_m, handle.theta_rad),
            queue=plant.contact.queue.handles(),
            occluders=plant.occluders,
        )


def make(context: NodeContext) -> WorldNode:
    """The simulated backend's process."""
    return WorldNode(context)
