"""Anything that the types of messages allow, and malformed bytes between, into the nodes that decide and compute."""

from __future__ import annotations

import tempfile
from functools import partial
from pathlib import Path
from random import Random
from typing import Any

from common.channels import Channel
from common.config import Config, default_config_path
from common.messages import Header, MessageError, encode
from common.node import Inbox, Node, NodeContext, Outbox
from common.processes import process
from common.request_desk import RequestDesk
from common.timing import NS_PER_MS, SteppedClock
from experiments.fuzz.messages import Mutator, valid_message
from experiments.fuzz.watch import BoundedCall, Tally

NODES = ("follower-supervisor", "follower-arms", "follower-controller", "follower-estimator")
_CYCLE_NS = 10 * NS_PER_MS
_VALID_SHARE = 0.9


class NodeBench:
    """One node in stepped time; its inputs come from nowhere else. What it publishes must be a message."""

    def __init__(self, name: str, config: Config, random: Random, folder: Path) -> None:
        self._random = random
        self._clock = SteppedClock()
        kept = config.model_copy(update={"state_directory": str(folder)})
        context = NodeContext(kept, default_config_path(), folder, 1, self._clock)
        self._node: Node = process(name).factory()(context)
        self._inbox = Inbox(self._clock.boot_id)
        self._outbox = Outbox(name, 1, self._clock.boot_id)
        self._desk = RequestDesk(
            self._clock.boot_id, lambda channel, answer: self._outbox.pack(channel, answer, self._clock.now_ns())
        )
        self._mutator = Mutator(random, self._clock.boot_id)
        self._sequence = 0
        self._node.start(self._clock.now_ns())

    def payload(self) -> tuple[Channel[Any], bytes]:
        """The next input: a channel of the node, and bytes."""
        random = self._random
        channel = random.choice((*self._node.inputs, *self._node.serves))
        if random.random() > _VALID_SHARE:
            return channel, self._mutator.payload(channel, self._clock.now_ns())
        self._sequence += 1
        now_ns = self._clock.now_ns()
        header = Header(channel.publisher, 1, self._sequence, now_ns, self._clock.boot_id)
        return channel, encode(valid_message(random, channel), header)

    def take(self, channel: Channel[Any], payload: bytes) -> str:
        """Receive one payload and step."""
        self._clock.advance_to(self._clock.now_ns() + _CYCLE_NS)
        now_ns = self._clock.now_ns()
        if channel.kind == "request":
            request = self._desk.admit(channel, payload, now_ns, lambda _reply: None)
            if request is not None and not self._inbox.put_request(channel, request):
                self._desk.withdraw(request.message.id)
        else:
            self._inbox.put_state(channel, payload, now_ns)
        self._inbox.begin_step()
        for out, message in self._node.step(now_ns, self._inbox):
            self._outbox.pack(out, message, now_ns)
        return ""

    def close(self) -> None:
        """End the node."""
        self._node.stop(self._clock.now_ns())


def run_node(name: str, config: Config, seed: int, count: int, until_s: float | None) -> Tally:
    """Feed a node.

    Args:
        name: of its process.
        config: the robots.
        seed: random seed.
        count: messages.
        until_s: time.monotonic() after which nothing more is sent; None: no such time.
    """
    random = Random(f"{name} {seed}")
    watch = BoundedCall(name, count, until_s)
    with tempfile.TemporaryDirectory(prefix="davpc-fuzz-") as folder:
        bench = NodeBench(name, config, random, Path(folder))
        while watch.goes_on:
            channel, payload = bench.payload()
            watch.attempt(payload, partial(bench.take, channel, payload), (MessageError,), label=channel.key)
        bench.close()
    return watch.finish()
