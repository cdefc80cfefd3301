"""The handshake with a socketcand server: bounded, and no frame lost that comes right behind it."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import pytest

from common.canopen.bus import CanBus
from common.canopen.frames import CanFrame
from common.config import BusConfig
from common.errors import DeviceError

_FRAME = b"< frame 181 1.000000 0102 >"


@contextmanager
def _server(answers: Sequence[bytes]) -> Iterator[BusConfig]:
    """Greets, then answers each request with the next of these; after the last it says nothing."""
    listener = socket.create_server(("127.0.0.1", 0))
    clients: list[socket.socket] = []

    def serve() -> None:
        while True:
            try:
                client, _ = listener.accept()
            except OSError:
                return
            clients.append(client)
            client.sendall(b"< hi >")
            for answer in answers:
                if not client.recv(256):
                    break
                client.sendall(answer)

    threading.Thread(target=serve, daemon=True).start()
    try:
        yield BusConfig(interface="socketcand", channel="follower", host="127.0.0.1", port=listener.getsockname()[1])
    finally:
        listener.close()
        for client in clients:
            client.close()


@pytest.mark.parametrize("answers", [[], [b"< ok >"]], ids=["no-open", "no-rawmode"])
def test_a_server_that_does_not_answer_is_named_within_seconds(answers: list[bytes]) -> None:
    began = time.monotonic()
    with _server(answers) as config, pytest.raises(DeviceError, match="server does not open follower: no answer"):
        CanBus(config)
    assert time.monotonic() - began < 6.0


def test_another_answer_is_shown() -> None:
    with _server([b"< error could not open bus >"]) as config, pytest.raises(DeviceError, match="could not open bus"):
        CanBus(config)


@pytest.mark.parametrize("last", [b"< ok >" + _FRAME, _FRAME + b"< ok >" + _FRAME, b"< ok > " + _FRAME[:9]])
def test_frames_right_behind_the_handshake_do_not_refuse_the_opening(last: bytes) -> None:
    with _server([b"< ok >", last, (_FRAME[9:] if len(last) < 20 else _FRAME)]) as config:
        bus = CanBus(config)
        bus.send(CanFrame(0x80, b""))
        assert bus.wait(2.0) == CanFrame(0x181, b"\x01\x02")
        bus.close()
