"""python-can's socketcand client with a bounded handshake, which keeps the frames that come right behind it."""

from __future__ import annotations

import select
import socket
import struct
import time
from typing import Any

import can
from can.interfaces.socketcand.socketcand import SocketCanDaemonBus

ANSWER_S = 2.0
_MOST_BYTES = 65536


class BoundedSocketcand(SocketCanDaemonBus):
    """A socketcand client whose opening and sending end within two seconds each."""

    def __init__(self, channel: str, **options: Any) -> None:
        self._unread = ""
        connect: Any = super().__init__
        try:
            connect(channel, **options)
        except BaseException:
            if (opened := vars(self).get("_SocketCanDaemonBus__socket")) is not None:
                opened.close()
            raise
        found: socket.socket = vars(self)["_SocketCanDaemonBus__socket"]
        found.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, struct.pack("ll", int(ANSWER_S), 0))
        vars(self)["_SocketCanDaemonBus__receive_buffer"] = self._unread

    def _expect_msg(self, msg: str) -> None:
        """Wait for an answer of the handshake; frames that arrive before it are from the bus and passed over.

        Raises:
            CanError: another answer, none in time, or the server closed the connection.
        """
        deadline = time.monotonic() + ANSWER_S
        while (answer := self._next(deadline)) != msg:
            if not answer.startswith("< frame"):
                raise can.CanError(f"the socketcand server answers {answer[:80]!r} in place of {msg!r}")

    def _next(self, deadline: float) -> str:
        found: socket.socket = vars(self)["_SocketCanDaemonBus__socket"]
        refusal = f"the socketcand server does not open {self.channel}"
        while ">" not in self._unread:
            left_s = deadline - time.monotonic()
            if left_s <= 0.0 or not select.select([found], [], [], left_s)[0]:
                raise can.CanError(f"{refusal}: no answer in {ANSWER_S:.0f} s")
            data = found.recv(1024)
            if not data or len(self._unread) > _MOST_BYTES:
                raise can.CanError(f"{refusal}: it closed the connection")
            self._unread += data.decode("ascii", errors="replace")
        answer, mark, self._unread = self._unread.partition(">")
        return (answer + mark).strip()
