"""Simulated drives behind a socket, in real time."""

from __future__ import annotations

import socket
import threading
import time

import pytest

from common.config import BusConfig
from common.timing import NS_PER_S
from follower.can_bridge.drive_bus import DriveBus
from follower.can_bridge.measurement import DriveSetpoint
from sim.can.nodes import FollowerBus
from sim.can.server import MOST_CLIENTS, CanServer
from tests.rigs.canbus_rig import (
    CONFIG_PATH,
    stepped_config,
)


def test_a_server_that_stood_still_says_so_to_its_nodes(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    robot = FollowerBus.build(stepped_config().follower_can, CONFIG_PATH)
    ticked, ahead_ns = threading.Event(), 0
    bus = robot.bus
    stalls: list[int] = []
    monkeypatch.setattr(bus, "excuse_stall", stalls.append)
    server = CanServer(
        socket.create_server(("127.0.0.1", 0)),
        {"follower": bus},
        lambda: time.monotonic_ns() + ahead_ns,
        lambda _: ticked.set(),
    )
    server.start()
    assert ticked.wait(10.0)
    ahead_ns = 60 * NS_PER_S
    while not any(stall >= 59 * NS_PER_S for stall in stalls):
        ticked.clear()
        assert ticked.wait(10.0)
    server.stop()
    assert "the simulated drives stalled for" in caplog.text


def test_the_same_over_a_socket() -> None:
    config = stepped_config()
    robot = FollowerBus.build(config.follower_can, CONFIG_PATH)
    ticked = threading.Event()
    listener = socket.create_server(("127.0.0.1", 0))
    server = CanServer(listener, {"follower": robot.bus}, time.monotonic_ns, lambda _: ticked.set())
    server.start()
    host, port = server.address
    bus = BusConfig(interface="socketcand", channel="follower", host=host, port=port)
    drives = DriveBus(config.follower_can.model_copy(update={"bus": bus}), config.base, CONFIG_PATH)
    drives.open()
    drives.enable()
    enabled = False
    for _ in range(2000):
        measured = drives.exchange(time.monotonic_ns(), DriveSetpoint(left_rad_s=1.0))
        enabled = enabled or measured.wheels_enabled
        if enabled and robot.left_wheel.velocity_setpoint_rad_s > 0.05:
            break
        ticked.clear()
        ticked.wait(1.0)
    assert measured.troubles == ()
    assert enabled
    server.stop()
    for _ in range(200):
        measured = drives.exchange(time.monotonic_ns(), DriveSetpoint())
        if not measured.bus_ok:
            break
    assert "CAN bus" in measured.bus_lost
    drives.close()


def test_a_client_too_many_and_one_that_left_at_once_cost_the_others_nothing(
    caplog: pytest.LogCaptureFixture,
) -> None:
    class Listener(socket.socket):
        refusals = 1

        def accept(self) -> tuple[socket.socket, object]:
            if self.refusals:
                self.refusals -= 1
                super().accept()[0].close()
                raise ConnectionAbortedError(103, "Software caused connection abort")
            return super().accept()

    listener = Listener(socket.AF_INET, socket.SOCK_STREAM)
    listener.bind(("127.0.0.1", 0))
    listener.listen(2 * MOST_CLIENTS)
    server = CanServer(listener, {}, time.monotonic_ns)
    server.start()
    links = [socket.create_connection(server.address, 10.0) for _ in range(MOST_CLIENTS + 2)]
    greetings = [link.recv(16) for link in links]
    assert greetings == [b"", *([b"< hi >"] * MOST_CLIENTS), b""]
    links[1].sendall(b"< echo >")
    assert links[1].recv(16) == b"< echo >"
    for link in links:
        link.close()
    server.stop()
    assert "connection abort" in caplog.text
    assert f"{MOST_CLIENTS} are connected" in caplog.text
