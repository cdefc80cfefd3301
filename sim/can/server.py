"""Simulated buses behind a TCP socket, in the protocol that python-can's ``socketcand`` interface speaks.

One thread serves every client. A client's frame goes to the nodes of its bus and to the other clients of that bus;
a node's frame goes to every client of its bus. Not modelled: arbitration, bit timing, error counters.

A real drive keeps running while this computer stalls. Simulated nodes stall with it and are late afterwards; their
watchdogs do not count the stall as silence of the master.
"""

from __future__ import annotations

import logging
import selectors
import socket
import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

from common.canopen.frames import ERROR_FLAG, CanFrame
from common.timing import NS_PER_MS
from sim.can.bus import SimulatedBus

TICK_MS = 5.0
MOST_CLIENTS = 64
_STALL_NS = 40 * NS_PER_MS
_SETTLE_NS = 50 * NS_PER_MS
_BACKLOG_BYTES = 1 << 20
_LINE_BYTES = 256
_log = logging.getLogger("world")


@dataclass
class _Client:
    """One connection. It gets no frame until it has read the answer to ``rawmode``: python-can confuses the two."""

    link: socket.socket
    bus: str | None = None
    raw: bool = False
    quiet_until_ns: int = 0
    received: bytes = b""
    outgoing: bytearray = field(default_factory=bytearray)


class CanServer:
    """Serves buses on a listening socket, from :meth:`start` to :meth:`stop`.

    ``before`` brings the plant up to date: it runs under ``lock``, with the time, before any frame is handled and at
    every tick. Other threads take the same lock before they touch a node.
    """

    def __init__(
        self,
        listener: socket.socket,
        buses: Mapping[str, SimulatedBus],
        now_ns: Callable[[], int],
        before: Callable[[int], None] | None = None,
    ) -> None:
        self.lock = threading.Lock()
        self._listener = listener
        self._buses = dict(buses)
        self._now_ns = now_ns
        self._before = before
        self._selector = selectors.DefaultSelector()
        self._clients: dict[socket.socket, _Client] = {}
        self._next_tick_ns = 0
        self._wake_in, self._wake_out = socket.socketpair()
        self._thread = threading.Thread(target=self._serve, name="can-server", daemon=True)
        self._failure: BaseException | None = None

    @property
    def address(self) -> tuple[str, int]:
        """Host and port on which it listens."""
        host, port = self._listener.getsockname()[:2]
        return str(host), int(port)

    def start(self) -> None:
        """Begin to serve."""
        self._listener.setblocking(False)
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._selector.register(self._wake_in, selectors.EVENT_READ)
        self._thread.start()

    def stop(self) -> None:
        """End every connection, close the listener, join the thread.

        Raises:
            RuntimeError: the server had failed; the cause is chained.
        """
        if self._thread.ident is not None:
            self._wake_out.send(b"x")
            self._thread.join()
        for client in list(self._clients.values()):
            self._drop(client)
        self._selector.close()
        for link in (self._listener, self._wake_in, self._wake_out):
            link.close()
        if self._failure is not None:
            raise RuntimeError("the simulated CAN server failed") from self._failure

    def _serve(self) -> None:
        try:
            while self._step():
                pass
        except BaseException as error:  # noqa: BLE001 - handed to stop(), which raises it
            self._failure = error

    def _step(self) -> bool:
        wait_s = max(self._next_tick_ns - self._now_ns(), 0) * 1e-9
        ready = self._selector.select(wait_s)
        self._report_stall(self._now_ns())
        for key, _ in ready:
            if key.fileobj is self._wake_in:
                return False
            if key.fileobj is self._listener:
                self._accept()
            elif isinstance(key.fileobj, socket.socket) and key.fileobj in self._clients:
                self._read(self._clients[key.fileobj])
        now_ns = self._now_ns()
        if now_ns >= self._next_tick_ns:
            self._tick(now_ns)
        for client in list(self._clients.values()):
            self._write(client)
        return True

    def _report_stall(self, now_ns: int) -> None:
        """Report a stall to the nodes before the queued frames are delivered."""
        late_ns = now_ns - self._next_tick_ns
        if not self._next_tick_ns or late_ns < _STALL_NS:
            return
        _log.warning("the simulated drives stalled for %d ms", late_ns // NS_PER_MS)
        with self.lock:
            for bus in self._buses.values():
                bus.excuse_stall(late_ns)

    def _accept(self) -> None:
        try:
            link, _ = self._listener.accept()
        except OSError as error:  # the caller has gone already, or no descriptor is left
            _log.warning("a client was not accepted: %s", error.strerror)
            return
        if len(self._clients) >= MOST_CLIENTS:
            _log.warning("a client was not accepted: %d are connected", MOST_CLIENTS)
            link.close()
            return
        link.setblocking(False)
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client = _Client(link, outgoing=bytearray(b"< hi >"))
        self._clients[link] = client
        self._selector.register(link, selectors.EVENT_READ)

    def _drop(self, client: _Client) -> None:
        if self._clients.pop(client.link, None) is not None:
            self._selector.unregister(client.link)
            client.link.close()

    def _read(self, client: _Client) -> None:
        try:
            data = client.link.recv(65536)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self._drop(client)
            return
        *lines, client.received = (client.received + data).split(b">")
        if len(client.received) > _LINE_BYTES:
            self._drop(client)
            return
        now_ns = self._now_ns()
        with self.lock:
            if client.raw and self._before is not None:
                self._before(now_ns)
            for line in lines:
                self._obey(client, line.split(), now_ns)

    def _obey(self, client: _Client, words: list[bytes], now_ns: int) -> None:
        match words:
            case [b"<", b"send", identifier, length, *octets] if client.raw and client.bus is not None:
                frame = _frame(identifier, length, octets)
                if frame is None:
                    client.outgoing += b"< error could not parse send >"
                    return
                client.quiet_until_ns = 0
                self._deliver(client.bus, [frame], now_ns, client)
                self._deliver(client.bus, self._buses[client.bus].handle(frame, now_ns), now_ns)
            case [b"<", b"open", name] if name.decode("ascii", "replace") in self._buses:
                client.bus = name.decode("ascii")
                client.outgoing += b"< ok >"
            case [b"<", b"rawmode"] if client.bus is not None:
                client.raw = True
                client.quiet_until_ns = now_ns + _SETTLE_NS
                client.outgoing += b"< ok >"
            case [b"<", b"echo"]:
                client.outgoing += b"< echo >"
            case _:
                client.outgoing += b"< error unknown command >"

    def _tick(self, now_ns: int) -> None:
        self._next_tick_ns = now_ns + round(TICK_MS * NS_PER_MS)
        with self.lock:
            if self._before is not None:
                self._before(now_ns)
            for name, bus in self._buses.items():
                self._deliver(name, bus.tick(now_ns), now_ns)

    def _deliver(self, bus: str, frames: Iterable[CanFrame], now_ns: int, sender: _Client | None = None) -> None:
        text = b"".join(_text(frame, now_ns) for frame in frames)
        if not text:
            return
        for client in self._clients.values():
            if client.raw and client.bus == bus and client is not sender and now_ns >= client.quiet_until_ns:
                client.outgoing += text

    def _write(self, client: _Client) -> None:
        """Send what fits; drop a client once a megabyte waits for it."""
        if not client.outgoing:
            return
        try:
            sent = client.link.send(client.outgoing)
        except BlockingIOError:
            sent = 0
        except OSError:
            self._drop(client)
            return
        del client.outgoing[:sent]
        if len(client.outgoing) > _BACKLOG_BYTES:
            self._drop(client)


def _text(frame: CanFrame, now_ns: int) -> bytes:
    """The frame as socketcand writes it in raw mode."""
    stamp = b"%d.%06d" % divmod(now_ns // 1000, 1_000_000)
    if frame.can_id & ERROR_FLAG:
        return b"< error %08X %s >" % (frame.can_id, stamp)
    return b"< frame %03X %s %s >" % (frame.can_id, stamp, frame.data.hex().encode())


def _frame(identifier: bytes, length: bytes, octets: list[bytes]) -> CanFrame | None:
    """A standard data frame of socketcand's text; None for anything else."""
    try:
        can_id, size = int(identifier, 16), int(length, 16)
        data = bytes(int(octet, 16) for octet in octets)
    except ValueError:
        return None
    if len(identifier) != 3 or not 0 <= can_id <= 0x7FF or size > 8 or size != len(data):
        return None
    return CanFrame(can_id, data)
