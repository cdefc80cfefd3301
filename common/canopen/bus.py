"""One CAN bus, opened as configured and used from one thread: sends and receives frames without blocking.

python-can gives the same interface to the kernel's CAN (``socketcan``), a socketcand server and stepped time, but
they fail in different ways: here every loss of the bus becomes a :class:`BusLostError`.
"""

from __future__ import annotations

import errno
import logging
import select
import socket
import time
from typing import Any

import can

from common.canopen.frames import BUS_OFF, CanFrame
from common.canopen.socketcand import BoundedSocketcand
from common.config import BusConfig
from common.errors import DeviceError

CONNECT_TIMEOUT_S = 2.0
DRAIN_LIMIT = 4096
_IDLE_READS = 20
_QUIET_LOGGERS = ("can", "canopen")


class BusLostError(DeviceError):
    """The bus is gone or bus-off; it has to be reopened."""


class CanBus:
    """Frames to and from one bus.

    ``overruns`` counts frames that a full transmit queue refused, ``oddities`` received frames that CANopen does not
    use: remote, extended, error.
    """

    def __init__(self, config: BusConfig) -> None:
        """Open the bus.

        Raises:
            DeviceError: interface, adapter or server is missing; the text names it.
        """
        self.name = _name(config)
        self.overruns = 0
        self.oddities = 0
        self._bus = _open(config, self.name)
        self._socket = _socket_of(self._bus)

    def send(self, frame: CanFrame) -> None:
        """Hand one frame to the bus.

        Raises:
            BusLostError: the interface is down or the server gone.
        """
        message = can.Message(arbitration_id=frame.can_id, data=frame.data, is_extended_id=False)
        try:
            self._bus.send(message)
        except (can.CanError, OSError) as error:
            # part of a line may be out to a server that takes no more: what follows would be garbage
            if self._socket is None and _code(error) in (errno.ENOBUFS, errno.EAGAIN):
                self.overruns += 1
                return
            raise BusLostError(f"CAN bus {self.name}: cannot send: {error}") from error

    def receive(self) -> list[CanFrame]:
        """Everything that has arrived, oldest first, without waiting.

        Raises:
            BusLostError: end of file, interface down, bus-off.
        """
        frames: list[CanFrame] = []
        while len(frames) < DRAIN_LIMIT:
            message = self._read(0.0)
            if message is None:
                self._check_alive()
                break
            frame = self._frame(message)
            if frame is not None:
                frames.append(frame)
        return frames

    def wait(self, timeout_s: float) -> CanFrame | None:
        """The next frame, or None if none came in time (in stepped time: if none is there).

        Raises:
            BusLostError: as for :meth:`receive`.
        """
        deadline = time.monotonic() + timeout_s
        idle = 0
        while idle < _IDLE_READS:
            remaining = deadline - time.monotonic()
            if remaining <= 0:
                return None
            message = self._read(remaining)
            if message is None:
                self._check_alive()
                idle += 1
                continue
            frame = self._frame(message)
            if frame is not None:
                return frame
        return None

    def hears(self, can_id: int, within_s: float) -> bool:
        """Whether a frame with this identifier comes in time (in stepped time: is there); others are skipped.

        Raises:
            BusLostError: as for :meth:`receive`.
        """
        deadline = time.monotonic() + within_s
        while (frame := self.wait(deadline - time.monotonic())) is not None:
            if frame.can_id == can_id:
                return True
        return False

    def close(self) -> None:
        """Close the bus; closing twice does nothing."""
        self._bus.shutdown()

    def _read(self, timeout_s: float) -> can.Message | None:
        # recv() of python-can takes its time-out from the wall clock: set back by an hour, it blocks for an hour
        try:
            return self._bus._recv_internal(timeout_s)[0]
        except (can.CanError, OSError, ValueError) as error:
            raise BusLostError(f"CAN bus {self.name}: cannot receive: {_first_line(error)}") from error

    def _frame(self, message: can.Message) -> CanFrame | None:
        if message.is_error_frame and message.arbitration_id & BUS_OFF:
            raise BusLostError(f"CAN bus {self.name}: bus-off")
        if message.is_error_frame or message.is_extended_id or message.is_remote_frame:
            self.oddities += 1
            return None
        return CanFrame(message.arbitration_id, bytes(message.data))

    def _check_alive(self) -> None:
        """python-can takes a closed socketcand server for silence: check for the end of file."""
        if self._socket is None:
            return
        try:
            ended = self._socket.recv(1, socket.MSG_PEEK | socket.MSG_DONTWAIT) == b""
        except BlockingIOError:
            return
        except OSError as error:
            raise BusLostError(f"CAN bus {self.name}: {error}") from error
        if ended:
            raise BusLostError(f"CAN bus {self.name}: the server closed the connection")


def _name(config: BusConfig) -> str:
    where = f" at {config.host}:{config.port}" if config.interface == "socketcand" else ""
    return f"{config.channel} ({config.interface}{where})"


def _open(config: BusConfig, name: str) -> can.BusABC:
    for logger in _QUIET_LOGGERS:  # both libraries log each frame and failure; here failures are raised
        logging.getLogger(logger).setLevel(logging.CRITICAL)
    options: dict[str, Any] = {}
    if config.interface == "socketcand":
        _knock(config, name)
        options = {"host": config.host, "port": config.port, "tcp_tune": True}
    try:
        if config.interface == "socketcand":
            return BoundedSocketcand(channel=config.channel, **options)
        return can.Bus(interface=config.interface, channel=config.channel, ignore_config=True, **options)
    except (can.CanError, OSError, ValueError) as error:
        raise DeviceError(f"CAN bus {name}: cannot be opened: {_first_line(error)}") from error


def _knock(config: BusConfig, name: str) -> None:
    """Check for a socketcand server: python-can would retry for ten busy seconds, then wait without end."""
    try:
        with socket.create_connection((config.host, config.port), CONNECT_TIMEOUT_S) as probe:
            if select.select([probe], [], [], CONNECT_TIMEOUT_S)[0] and probe.recv(16).startswith(b"< hi >"):
                return
    except OSError as error:
        raise DeviceError(f"CAN bus {name}: no socketcand server: {error.strerror or error}") from error
    raise DeviceError(f"CAN bus {name}: the server there is not socketcand")


def _socket_of(bus: can.BusABC) -> socket.socket | None:
    """The private TCP socket of python-can's socketcand interface."""
    found = getattr(bus, "_SocketCanDaemonBus__socket", None)
    return found if isinstance(found, socket.socket) else None


def _code(error: Exception) -> int | None:
    cause: BaseException | None = error
    while cause is not None:
        code = getattr(cause, "error_code", None) or getattr(cause, "errno", None)
        if code is not None:
            return int(code)
        cause = cause.__cause__
    return None


def _first_line(error: Exception) -> str:
    return str(error).strip().split("\n", 1)[0]
