"""The parts of python-can that it does not show and that the bus relies on, and a server that goes away."""

from __future__ import annotations

import inspect
import socket
import time

import can
import pytest
from can.interfaces.socketcan import SocketcanBus
from can.interfaces.socketcand import SocketCanDaemonBus

from common.canopen.bus import BusLostError, CanBus, _socket_of
from common.config import BusConfig
from sim.can.bus import SimulatedBus
from sim.can.server import CanServer
from sim.can.stepped_bus import SteppedBus

CHANGED = f"python-can {can.__version__} no longer has what common/canopen/bus.py uses: {{}}; adapt it"


def serve() -> CanServer:
    server = CanServer(socket.create_server(("127.0.0.1", 0)), {"follower": SimulatedBus(())}, time.monotonic_ns)
    server.start()
    return server


def opened(server: CanServer) -> CanBus:
    host, port = server.address
    return CanBus(BusConfig(interface="socketcand", channel="follower", host=host, port=port))


@pytest.mark.parametrize("interface", [SocketcanBus, SocketCanDaemonBus, SteppedBus])
def test_every_interface_receives_without_the_wall_clock(interface: type[can.BusABC]) -> None:
    own = vars(interface).get("_recv_internal")
    assert own is not None, CHANGED.format(f"{interface.__name__}._recv_internal")
    assert list(inspect.signature(own).parameters) == ["self", "timeout"], CHANGED.format("its parameters")


def test_silence_is_no_message_and_a_server_that_closes_is_a_lost_bus() -> None:
    server = serve()
    try:
        bus = opened(server)
        assert bus._bus._recv_internal(0.0)[0] is None, CHANGED.format("_recv_internal's (message, filtered)")
        assert _socket_of(bus._bus) is not None, CHANGED.format("the socket of SocketCanDaemonBus")
        assert bus.receive() == []
    finally:
        server.stop()
    with pytest.raises(BusLostError, match="the server closed the connection"):
        bus.wait(10.0)
    bus.close()
