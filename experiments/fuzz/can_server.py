"""Malformed text into the simulated buses' TCP server, from a client; another must be served on."""

from __future__ import annotations

import contextlib
import socket
import time
from random import Random
from types import TracebackType
from typing import Self

from common.config import Config, default_config_path
from experiments.fuzz.mutate import spoilt
from experiments.fuzz.watch import BoundedCall, Tally
from sim.can.nodes import FollowerBus, LeaderBus
from sim.can.server import CanServer

_ANSWER_S = 2.0
_CONNECTED = 20
"""Inputs over one connection, at most."""
_PARTS = (
    b"< open can0 >", b"< open leader >", b"< open \xff >", b"< rawmode >", b"< rawmode", b"< echo >", b"< >", b">",
    b"<", b"< send 123 8 1 2 3 4 5 6 7 8 >", b"< send 000 2 1 0 >", b"< send 601 8 40 0 10 0 0 0 0 0 >",
    b"< send 7FF 0 >", b"< send fff 1 1 >", b"< send -01 1 1 >", b"< send 1_1 1 1 >", b"< send 123 1 100 >",
    b"< send 123 9 1 2 3 4 5 6 7 8 9 >", b"< send 123 1 -1 >", b"< send 123 " + b"f" * 200 + b" 1 >",
    b"< send 123 2 1 >", b"x" * 300, b"\0" * 300, b"> " * 3000,
)  # fmt: skip


class ServerBench:
    """A server with both robots' buses, a client that is good, and one after the other that is not."""

    def __init__(self, config: Config, random: Random) -> None:
        self._random = random
        path = default_config_path()
        follower, leader = config.follower_can, config.leader_can
        self._channels = [can.bus.channel.encode() for can in (follower, leader)]
        buses = {
            follower.bus.channel: FollowerBus.build(follower, path).bus,
            leader.bus.channel: LeaderBus.build(leader, path).bus,
        }
        self._server = CanServer(socket.create_server(("127.0.0.1", 0)), buses, time.monotonic_ns)
        self._bad: socket.socket | None = None
        self._left = 0

    def __enter__(self) -> Self:
        self._server.start()
        self._good = socket.create_connection(self._server.address, _ANSWER_S)
        self._heard = b""
        self._hear(b"< hi >")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None
    ) -> None:
        self._good.close()
        self._hang_up()
        with contextlib.suppress(RuntimeError):  # what failed is a finding already
            self._server.stop()

    def text(self) -> bytes:
        """The next input."""
        random = self._random
        parts = [random.choice(_PARTS) for _ in range(random.randrange(1, 6))]
        if random.random() < 0.4:
            parts = [b"< open %s >" % random.choice(self._channels), b"< rawmode >", *parts]
        text = b"".join(parts)
        return spoilt(random, text) if random.random() < 0.6 else text

    def take(self, text: bytes) -> str:
        """Send it, and see that the good client is still answered."""
        if self._bad is None or self._left == 0:
            self._hang_up()
            self._bad = socket.create_connection(self._server.address, _ANSWER_S)
            self._left = self._random.randrange(1, _CONNECTED)
        self._left -= 1
        try:
            self._bad.sendall(text)
        except OSError:
            self._left = 0  # the server has dropped it
        self._good.sendall(b"< echo >")
        return "" if self._hear(b"< echo >") else "a good client is not served any more"

    def _hear(self, wanted: bytes) -> bool:
        while wanted not in self._heard:
            try:
                data = self._good.recv(4096)
            except TimeoutError:
                return False
            if not data:
                return False
            self._heard += data
        self._heard = self._heard.partition(wanted)[2]
        return True

    def _hang_up(self) -> None:
        if self._bad is not None:
            if self._random.random() < 0.3:  # a reset instead of an end
                self._bad.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
            self._bad.close()
            self._bad = None


def run_server(config: Config, seed: int, count: int, until_s: float | None) -> Tally:
    """Send malformed text to the server.

    Args:
        config: the robots.
        seed: random seed.
        count: inputs.
        until_s: time.monotonic() after which nothing more is sent; None: no such time.
    """
    random = Random(f"server {seed}")
    watch = BoundedCall("CAN server", count, until_s)
    with ServerBench(config, random) as bench:
        while watch.goes_on:
            text = bench.text()
            watch.attempt(text, lambda text=text: bench.take(text))  # type: ignore[misc] # called at once
    return watch.finish()
