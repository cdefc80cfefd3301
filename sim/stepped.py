"""The stepped executor: many nodes in one process, in time that moves from event to event.

Deterministic for a seed and many times faster than real time. Messages are encoded and decoded as on the wire and
arrive after a fixed delay; the outputs of a step leave after the node's fixed duration. Not modelled: jitter, lost
messages, nodes that compete for a core.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any

from common.channels import Channel, journal_channel, snapshot_channel
from common.messages import Answer, Header, Message, decode
from common.node import Inbox, Node, Outbox
from common.processes import PROCESSES
from common.recording import snapshot
from common.recording.journal import JournalWriter, OpenStep
from common.request_desk import RequestDesk
from common.timing import NS_PER_MS, NS_PER_S, SteppedClock

TRANSPORT_DELAY_NS = NS_PER_MS // 3
DURATION_NS: Mapping[str, int] = {
    "follower-camera": 2 * NS_PER_MS,
    "follower-estimator": 2 * NS_PER_MS,
    "follower-controller": 5 * NS_PER_MS,
}
JOURNAL_PERIOD_NS = NS_PER_S // 2
SNAPSHOT_PERIOD_NS = 10 * NS_PER_S
Tap = Callable[[Channel[Any], bytes, int], None]


@dataclass
class _RunningNode:
    node: Node
    inbox: Inbox
    outbox: Outbox
    desk: RequestDesk
    journal: JournalWriter | None = None
    due: bool = False


class _SharedDecoder:
    """Decodes a payload once for all nodes that receive it, with the checks of the wire; messages are frozen."""

    def __init__(self) -> None:
        self._newest: dict[type[Any], tuple[bytes, tuple[Header, Any]]] = {}

    def __call__(self, message_type: type[Any], payload: bytes) -> tuple[Header, Any]:
        """As :func:`common.messages.decode`."""
        known = self._newest.get(message_type)
        if known is not None and known[0] is payload:
            return known[1]
        decoded: tuple[Header, Any] = decode(message_type, payload)
        self._newest[message_type] = payload, decoded
        return decoded


class SteppedExecutor:
    """Runs nodes in the order of their events; events of one instant in the order of their creation.

    Args:
        nodes: started in this order, stopped in reverse.
        clock: advanced by the executor only; simulated devices may read it.
        tap: called with every message as it leaves, and its time, for recording.
        journals: of the nodes whose contexts have one, by the node's name; they go to ``tap``.
    """

    def __init__(
        self,
        nodes: Sequence[Node],
        clock: SteppedClock,
        tap: Tap = lambda _channel, _payload, _time_ns: None,
        journals: Mapping[str, JournalWriter] = MappingProxyType({}),
    ) -> None:
        self._clock, self._tap, self._journals = clock, tap, journals
        decoder = _SharedDecoder()
        self._running = [self._made(node, number, decoder) for number, node in enumerate(nodes, start=1)]
        self._receivers: dict[str, list[tuple[_RunningNode, bool]]] = {}
        for running in self._running:
            wakes = {channel.key for channel in running.node.trigger.wakes}
            for channel in running.node.inputs:
                self._receivers.setdefault(channel.key, []).append((running, channel.key in wakes))
        self._events: list[tuple[int, int, Callable[[], None]]] = []
        self._order = itertools.count()
        self._stack = ExitStack()
        self._cut_ns: int | None = None
        self._halted: set[str] = set()
        self._missed: set[str] = set()
        self._robot = {entry.name: entry.robot for entry in PROCESSES}

    def __enter__(self) -> SteppedExecutor:
        with ExitStack() as stack:
            for running in self._running:
                stack.callback(self._stop, running.node)
                running.node.start(self._clock.now_ns())
                if running.node.trigger.period_ns:
                    self._at(self._clock.now_ns(), partial(self._periodic, running))
            if self._journals:
                self._keep_journals()
                self._keep_snapshots()
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        if self._journals:
            self._keep_journals()
        self._stack.close()

    def _stop(self, node: Node) -> None:
        node.stop(self._clock.now_ns())

    def run(self, until_ns: int, finished: Callable[[], bool] = lambda: False) -> None:
        """Run events up to ``until_ns``, or until ``finished()`` is true after one."""
        while self._events and self._events[0][0] <= until_ns and not finished():
            time_ns, _, work = heapq.heappop(self._events)
            self._clock.advance_to(time_ns)
            work()

    def cut_link(self, from_ns: int) -> None:
        """From this time on no message passes between the robots; those of the simulated world still do."""
        self._cut_ns = from_ns

    def halt(self, name: str) -> None:
        """Stop stepping node ``name``, as if its process were gone."""
        self._halted.add(name)

    def resume(self, name: str) -> None:
        """Step node ``name`` again after :meth:`halt`, with the messages that wait: at once if it missed a step."""
        self._halted.discard(name)
        if name in self._missed:
            self._missed.discard(name)
            self._wake(next(running for running in self._running if running.node.name == name))

    def _made(self, node: Node, number: int, decoder: _SharedDecoder) -> _RunningNode:
        boot_id = self._clock.boot_id
        outbox = Outbox(node.name, number, boot_id)
        journal = self._journals.get(node.name)
        return _RunningNode(node, Inbox(boot_id, decoder, journal), outbox, self.desk(outbox), journal)

    def _keep_journals(self) -> None:
        """Hand the journals' batches to the tap, now and at the end too."""
        now_ns = self._clock.now_ns()
        for running in self._running:
            if running.journal is not None:
                channel = journal_channel(running.node.name)
                for batch in running.journal.batches():
                    self._tap(channel, running.outbox.pack(channel, batch, now_ns), now_ns)
        self._at(now_ns + JOURNAL_PERIOD_NS, self._keep_journals)

    def _keep_snapshots(self) -> None:
        now_ns = self._clock.now_ns()
        for running in self._running:
            if running.journal is not None:
                channel = snapshot_channel(running.node.name)
                for part in snapshot.take(running.node, running.inbox, running.journal.steps):
                    self._tap(channel, running.outbox.pack(channel, part, now_ns), now_ns)
        self._at(now_ns + SNAPSHOT_PERIOD_NS, self._keep_snapshots)

    def desk(self, outbox: Outbox) -> RequestDesk:
        """The desk of a process that begins now."""
        return RequestDesk(
            self._clock.boot_id, lambda channel, answer: outbox.pack(channel, answer, self._clock.now_ns())
        )

    @property
    def malformed(self) -> int:
        """Messages that a node could not decode."""
        return sum(running.inbox.malformed for running in self._running)

    def _at(self, time_ns: int, work: Callable[[], None]) -> None:
        heapq.heappush(self._events, (time_ns, next(self._order), work))

    def _periodic(self, running: _RunningNode) -> None:
        self._at(self._clock.now_ns() + running.node.trigger.period_ns, partial(self._periodic, running))
        self._step(running)

    def _wake(self, running: _RunningNode) -> None:
        """Schedule one step for everything that arrives at this instant."""
        if not running.due:
            running.due = True
            self._at(self._clock.now_ns(), partial(self._woken, running))

    def _woken(self, running: _RunningNode) -> None:
        running.due = False
        self._step(running)

    def _parted(self, one: _RunningNode, other: _RunningNode) -> bool:
        """Whether the cut link lies between two nodes; a node outside the process table is on no robot."""
        assert self._cut_ns is not None
        robots = {self._robot.get(one.node.name), self._robot.get(other.node.name)}
        return robots == {"follower", "leader"} and self._clock.now_ns() >= self._cut_ns

    def _step(self, running: _RunningNode) -> None:
        if running.node.name in self._halted:
            self._missed.add(running.node.name)
            return
        now_ns = self._clock.now_ns()
        entry = running.journal.begin(now_ns) if running.journal is not None else None
        running.inbox.begin_step()
        outputs = running.node.step(now_ns, running.inbox)
        if running.journal is not None and entry is not None:
            running.journal.end(entry, len(outputs))
        leaves_ns = now_ns + DURATION_NS.get(running.node.name, 0)
        for channel, message in outputs:
            self._at(leaves_ns, partial(self._send, running, entry, channel, message))

    def _send(self, sender: _RunningNode, entry: OpenStep | None, channel: Channel[Any], message: Message) -> None:
        now_ns = self._clock.now_ns()
        payload = sender.outbox.pack(channel, message, now_ns)
        if sender.journal is not None and entry is not None:
            sender.journal.sent(entry, channel, message, payload, now_ns, sender.outbox.sequence(channel))
        self._tap(channel, payload, now_ns)
        arrives_ns = now_ns + TRANSPORT_DELAY_NS
        if isinstance(message, Answer):
            sender.desk.settle(message, payload)
        elif channel.kind == "request":
            self._at(arrives_ns, partial(self._ask, sender, channel, payload))
        else:
            for receiver, wakes in self._receivers.get(channel.key, ()):
                if self._cut_ns is not None and self._parted(sender, receiver):
                    continue
                self._at(arrives_ns, partial(self._deliver, receiver, wakes, channel, payload))

    def _deliver(self, receiver: _RunningNode, wakes: bool, channel: Channel[Any], payload: bytes) -> None:
        receiver.inbox.put_state(channel, payload, self._clock.now_ns())
        if wakes:
            self._wake(receiver)

    def _ask(self, asker: _RunningNode, channel: Channel[Any], payload: bytes) -> None:
        for server in self._running:
            if self._cut_ns is not None and self._parted(asker, server):
                continue
            if any(channel.key == served.key for served in server.node.serves):

                def reply(answer: bytes) -> None:
                    arrives_ns = self._clock.now_ns() + TRANSPORT_DELAY_NS
                    self._at(arrives_ns, partial(self._answered, asker, channel, answer))

                request = server.desk.admit(channel, payload, self._clock.now_ns(), reply)
                if request is not None:
                    if not server.inbox.put_request(channel, request):
                        raise RuntimeError(f"{channel.key}: too many requests wait")
                    self._wake(server)

    def _answered(self, asker: _RunningNode, channel: Channel[Any], answer: bytes) -> None:
        asker.inbox.put_answer(channel, answer, self._clock.now_ns())
        self._wake(asker)
