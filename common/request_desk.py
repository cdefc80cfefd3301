"""Each request is carried out once: judged by its owner's own clock, remembered, and remembered over a restart.

A request has an id, which its sender keeps while it repeats it, and a header, whose sequence grows with each sending.
The desk refuses what is stamped in another boot or in the future, what stays valid for longer than a minute, an id
that stands for something else, and bytes that were seen before: of each sender's run only higher sequences are taken.
Those marks outlive the process in a file, so that a recorded request does nothing after a restart either.
"""

from __future__ import annotations

import json
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from common.channels import Channel
from common.files.parsing import UnreadableError, parse_json
from common.messages import Answer, Header, Message, MessageError, decode
from common.node import Received
from common.timing import NS_PER_S

LONGEST_VALID_NS = 60 * NS_PER_S
KEPT_NS = 2 * LONGEST_VALID_NS
MOST_KEPT = 4096
MOST_MARKS = 1024
_SCHEMA = "requests_seen/1"

Reply = Callable[[bytes], None]
Pack = Callable[[Channel[Any], Answer], bytes]


@dataclass
class _Asked:
    """A request that was handed to the node: what it was, when it came, who waits, and its answer in time."""

    content: Message
    since_ns: int
    reply: Reply | None
    answer: bytes | None = None


class RequestDesk:
    """Stands between the wire and a node's inbox of requests; not thread-safe.

    Args:
        boot_id: of this machine; requests within a robot must be stamped in it.
        pack: the bytes of an answer on a channel.
    """

    def __init__(self, boot_id: str, pack: Pack) -> None:
        self._boot_id = boot_id
        self._pack = pack
        self._asked: OrderedDict[str, _Asked] = OrderedDict()
        self._marks: OrderedDict[tuple[str, str, int], int] = OrderedDict()

    def admit(self, channel: Channel[Any], payload: bytes, now_ns: int, reply: Reply) -> Received[Any] | None:
        """The request, if the node has yet to see it; any other is answered here, or with its first sending.

        Args:
            channel: a request channel that this process serves.
            payload: bytes as received.
            now_ns: CLOCK_MONOTONIC.
            reply: takes the bytes of the answer, once.

        Raises:
            MessageError: not a request; it was answered.
        """
        self._forget(now_ns)
        try:
            header, message = decode(channel.message, payload)
        except MessageError as error:
            reply(self._pack(channel, Answer("", "refused", f"not a request: {error}"[:400])))
            raise
        refusal = self._refusal(channel, header, message, now_ns)
        if refusal:
            reply(self._pack(channel, Answer(message.id, "refused", refusal)))
            return None
        self._mark(channel, header)
        known = self._asked.get(message.id)
        if known is not None:
            if known.answer is not None:
                reply(known.answer)
            else:
                known.reply = reply
            return None
        self._asked[message.id] = _Asked(message, now_ns, reply)
        return Received(message, header, now_ns)

    def settle(self, answer: Answer, payload: bytes) -> None:
        """Hand the node's answer to the sender that waits, and keep it for one that repeats its request."""
        asked = self._asked.get(answer.id)
        if asked is None:
            return
        reply, asked.reply, asked.answer = asked.reply, None, payload
        if reply is not None:
            reply(payload)

    def withdraw(self, request_id: str) -> None:
        """Forget a request that the node will not get: the same id may be sent again."""
        self._asked.pop(request_id, None)

    def content(self) -> str:
        """The marks as a file."""
        seen = [[*key, sequence] for key, sequence in self._marks.items()]
        return json.dumps({"schema": _SCHEMA, "seen": seen}) + "\n"

    def restore(self, text: str) -> None:
        """Take the marks of an earlier run.

        Raises:
            UnreadableError: not such a file; nothing was taken.
        """
        table = parse_json(text)
        if not isinstance(table, dict) or table.get("schema") != _SCHEMA or not isinstance(table.get("seen"), list):
            raise UnreadableError(f"not a file of schema {_SCHEMA}")
        marks: OrderedDict[tuple[str, str, int], int] = OrderedDict()
        for entry in table["seen"][-MOST_MARKS:]:
            match entry:
                case [str(key), str(source), int(run_id), int(sequence)]:
                    marks[key, source, run_id] = sequence
                case _:
                    raise UnreadableError("an entry that is no [key, source, run, sequence]")
        self._marks = marks

    def _refusal(self, channel: Channel[Any], header: Header, message: Any, now_ns: int) -> str:
        """Why a request is not taken at all; a repeated one is judged by its id."""
        expires_ns = getattr(message, "expires_ns", None)
        if channel.reach == "robot" and header.boot_id != self._boot_id:
            return "stamped in another boot of this computer"
        if channel.reach == "robot" and header.stamp_ns > now_ns:
            return "stamped in the future"
        if expires_ns is not None and expires_ns - now_ns > LONGEST_VALID_NS:
            return f"valid for longer than {LONGEST_VALID_NS // NS_PER_S} s"
        known = self._asked.get(message.id)
        if known is not None:
            return "" if known.content == message else "this id stands for another request"
        if header.sequence <= self._marks.get(_key(channel, header), -1):
            return "seen before: a request is carried out once"
        if len(self._asked) >= MOST_KEPT and not getattr(message, "urgent", False):
            return "too many requests"
        return ""

    def _mark(self, channel: Channel[Any], header: Header) -> None:
        key = _key(channel, header)
        self._marks[key] = max(header.sequence, self._marks.get(key, -1))
        self._marks.move_to_end(key)
        if len(self._marks) > MOST_MARKS:
            self._marks.popitem(last=False)

    def _forget(self, now_ns: int) -> None:
        """Drop what can no longer be valid, answered or not."""
        while self._asked:
            oldest = next(iter(self._asked))
            if now_ns - self._asked[oldest].since_ns <= KEPT_NS:
                return
            del self._asked[oldest]


def _key(channel: Channel[Any], header: Header) -> tuple[str, str, int]:
    return channel.key, header.source, header.run_id
