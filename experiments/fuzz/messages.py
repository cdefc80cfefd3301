"""Malformed messages on every channel, through the inbox and the desk of requests as an executor uses them."""

from __future__ import annotations

import dataclasses
import zlib
from functools import partial
from random import Random
from typing import Any, get_type_hints

import msgpack

from common.channels import CHANNELS, Channel, health_channel
from common.messages import Answer, Command, Header, MessageError, encode, seal_command
from common.node import Inbox, Outbox
from common.request_desk import RequestDesk
from common.timing import NS_PER_MS, NS_PER_S
from experiments.fuzz.mutate import HOSTILE, allowed, mutated, spoilt
from experiments.fuzz.watch import BoundedCall, Tally

BOOT = "boot"
CHANNELS_FUZZED: tuple[Channel[Any], ...] = (*CHANNELS, health_channel("leader"))
_HOSTILE = (*HOSTILE, b"", b"\xff" * 8, msgpack.ExtType(5, b"x"), msgpack.Timestamp(2**33, 5))
_HOSTILE_BYTES = (
    b"\x91" * 5_000,
    b"\x81\xa1a" * 2_000,
    b"\x94\xdd\xff\xff\xff\xff",
    b"\x94\xc6\xff\xff\xff\xff",
    b"\x94\xa9command/1\x85\x80\x80",
    b"\x94\xa9command/1\x80\x81\x90\x01\x00",
    b"\x94\xd6\xff\xff\xff\xff\xff\x80\x80\x00",
    b"\xc1",
    b"\0" * 70_000,
)
_POOL = 60
_RESTORED_EVERY = 997


def valid_message(random: Random, channel: Channel[Any]) -> Any:
    """A message of the channel whose fields are anything that their types allow."""
    hints = get_type_hints(channel.message, include_extras=True)
    fields = {each.name: allowed(random, hints[each.name]) for each in dataclasses.fields(channel.message)}
    message = channel.message(**fields)
    return seal_command(message) if isinstance(message, Command) else message


class Mutator:
    """Makes malformed payloads out of valid messages, stamped in the boot ``boot_id``."""

    def __init__(self, random: Random, boot_id: str = BOOT) -> None:
        self._random, self._boot_id = random, boot_id
        self._sequence = 0
        self._pools: dict[str, list[Any]] = {}

    def payload(self, channel: Channel[Any], now_ns: int) -> bytes:
        """Bytes for the channel: most of them malformed, now and then valid."""
        random = self._random
        self._sequence += 1
        source = random.choice(("a", "b", channel.publisher, f"source-{random.randrange(3000)}"))
        stamp_ns = max(0, now_ns - random.choice((0, 0, NS_PER_MS, NS_PER_S)))
        header = Header(source, random.choice((1, 2, 2**62)), self._sequence, stamp_ns, self._boot_id)
        if random.random() < 0.02:
            return random.choice(_HOSTILE_BYTES)
        payload = encode(self._message(channel, now_ns), header)
        match random.randrange(8):
            case 0:
                return payload
            case 1 | 2:
                return spoilt(random, payload)
            case _:
                return self._repacked(payload)

    def _message(self, channel: Channel[Any], now_ns: int) -> Any:
        random = self._random
        pool = self._pools.setdefault(channel.key, [])
        if len(pool) < _POOL:
            pool.append(valid_message(random, channel))
        elif random.random() < 0.01:
            pool[random.randrange(_POOL)] = valid_message(random, channel)
        message = random.choice(pool)
        if channel.kind != "request":
            return message
        changes: dict[str, Any] = {"id": f"request-{random.randrange(20_000)}"}
        if hasattr(message, "expires_ns") and random.random() < 0.8:
            changes["expires_ns"] = now_ns + NS_PER_S
        return dataclasses.replace(message, **changes)

    def _repacked(self, payload: bytes) -> bytes:
        """One part changed, and in most the checksum made to fit again."""
        random = self._random
        parts = list(msgpack.unpackb(payload))
        place = random.choice((0, 1, 2, 2, 2, 2, 3))
        for _ in range(random.choice((1, 1, 2))):
            parts[place] = mutated(random, parts[place], _HOSTILE)
        try:
            if place != 3 and random.random() < 0.9:
                parts[3] = zlib.crc32(msgpack.packb(parts[1:3]))
            packed: bytes = msgpack.packb(parts)
        except (OverflowError, ValueError):
            return payload[:-1]  # what MessagePack cannot express
        return packed


class Receiver:
    """One process's end of the wire: inbox, desk, and the answers of a node that takes every request."""

    def __init__(self, random: Random) -> None:
        self._random = random
        self.now_ns = 10 * NS_PER_S
        self._inbox = Inbox(BOOT)
        self._outbox = Outbox("leader", 1, BOOT)
        self._desk = self._new_desk()
        self._steps = 0

    def take(self, channel: Channel[Any], payload: bytes) -> str:
        """Receive one payload, and step; what is wrong with the result."""
        self.now_ns += NS_PER_MS
        self._steps += 1
        if channel.kind == "request":
            return self._take_request(channel, payload)
        before = self._inbox.malformed
        self._inbox.put_state(channel, payload, self.now_ns)
        self._inbox.begin_step()
        self._inbox.fresh(channel, self.now_ns)
        arrived = self._inbox.arrived(channel)
        if self._inbox.malformed > before:
            if arrived is not None:
                return "a malformed message arrives"
            raise MessageError(self._inbox.faults[-1])
        self._inbox.put_answer(channel, payload, self.now_ns)
        return ""

    def _take_request(self, channel: Channel[Any], payload: bytes) -> str:
        replies: list[bytes] = []
        request = self._desk.admit(channel, payload, self.now_ns, replies.append)
        if request is not None and not self._inbox.put_request(channel, request):
            self._desk.withdraw(request.message.id)
        if self._random.random() < 0.1:
            for each in self._inbox.requests(channel):
                answer = Answer(each.message.id, "done", "")
                self._desk.settle(answer, self._outbox.pack(channel, answer, self.now_ns))
        if len(replies) > 1:
            return "a request is answered twice"
        if self._steps % _RESTORED_EVERY == 0:
            content = self._desk.content()
            self._desk = self._new_desk()
            self._desk.restore(content)
        return ""

    def _new_desk(self) -> RequestDesk:
        return RequestDesk(BOOT, lambda channel, answer: self._outbox.pack(channel, answer, self.now_ns))


def run_messages(seed: int, count: int, until_s: float | None) -> Tally:
    """Send ``count`` payloads over all channels in turn."""
    random = Random(seed)
    watch, receiver, mutator = BoundedCall("messages", count, until_s), Receiver(random), Mutator(random)
    while watch.goes_on:
        channel = random.choice(CHANNELS_FUZZED)
        payload = mutator.payload(channel, receiver.now_ns)
        watch.attempt(payload, partial(receiver.take, channel, payload), (MessageError,), label=channel.key)
    return watch.finish()
