"""What a node is, and what the executor that runs it guarantees.

A node declares its channels and has ``step(now_ns, inputs) → outputs``. Two executors run the same nodes:
:mod:`common.executor` as a process over Zenoh, :mod:`sim.stepped` many in one process in stepped time.
Both guarantee:

* ``start`` runs once before the first step and ``stop`` once after the last, also after a failure;
* ``step`` runs at each absolute ``period_ns`` and on each arrival on a channel in ``wakes``, never twice at once;
* of a state channel only the newest message is kept; requests and answers are all kept, in order;
* every message passes through the wire's encoding, so that nodes share no objects.
"""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar, cast

from common.channels import Channel
from common.config import Config
from common.messages import Answer, Header, Message, MessageError, decode, encode
from common.timing import NS_PER_MS, NS_PER_S, Clock

M = TypeVar("M", bound=Message)
D = TypeVar("D")
Output = tuple[Channel[Any], Message]
Decoder = Callable[[type[Any], bytes], tuple[Header, Any]]
REQUEST_BACKLOG, URGENT_BACKLOG = 64, 8
EARLY_NS = LATE_NS = 20 * NS_PER_MS


class StepWatch(Protocol):
    """What is to be kept of a node's steps for a replay, see :mod:`common.recording.journal`."""

    def states(self, arrived: Mapping[str, tuple[bytes, int]], late: Mapping[str, int]) -> None:
        """A step begins with these states: payload and time of receipt by key."""

    def taken(self, key: str, received: Sequence[Received[Any]]) -> None:
        """It took these requests or answers."""

    def device(self, name: str, device: Any) -> Any:
        """The device as the node is to use it."""


@dataclass(frozen=True)
class NodeContext:
    """What a node is made from: the configuration and the facts of this run.

    ``clock`` is for nodes whose device or deadline needs the time within a step; algorithms get ``now_ns``.
    """

    config: Config
    config_path: Path
    runtime: Path
    run_id: int
    clock: Clock
    watch: StepWatch | None = None

    def device(self, name: str, device: D) -> D:
        """The device for the node to use: what it returns within a step is kept for a replay.

        Args:
            name: unique within the node.
            device: whatever brings into a step what neither messages nor clock do; its methods have return types.
        """
        return device if self.watch is None else cast(D, self.watch.device(name, device))


@dataclass(frozen=True)
class Trigger:
    """When a node steps: every ``period_ns`` (0: never by time), and on each message of a channel in ``wakes``.

    ``free``: continuously, for a node whose step waits for its device.
    """

    period_ns: int = 0
    wakes: tuple[Channel[Any], ...] = ()
    free: bool = False


@dataclass(frozen=True)
class Received(Generic[M]):
    """A message, its header, and the local time of its receipt."""

    message: M
    header: Header
    receipt_ns: int


class Inbox:
    """Messages on their way into a node: the newest of each state channel, all requests and answers.

    A state is decoded in the step, and only if the node looks at it; a request or an answer when it arrives. What
    cannot be decoded is counted in ``malformed`` and named in ``faults``, for the executor to log.
    """

    def __init__(self, boot_id: str | None, decoder: Decoder = decode, watch: StepWatch | None = None) -> None:
        self._boot_id = boot_id
        self._decoder = decoder
        self._watch = watch
        self._incoming: dict[str, tuple[bytes, int]] = {}
        self._newest: dict[str, tuple[bytes, int]] = {}
        self._decoded: dict[str, tuple[bytes, Received[Any] | None]] = {}
        self._arrived: set[str] = set()
        self._arriving: set[str] = set()
        self._spoilt: set[str] = set()
        self._malformed: dict[str, int] = {}
        self._late: dict[str, int] = {}
        self._lock = threading.Lock()
        self._queues: dict[str, deque[Received[Any]]] = {}
        self.malformed = 0
        self.faults: deque[str] = deque(maxlen=16)

    def put_state(self, channel: Channel[Any], payload: bytes, receipt_ns: int) -> None:
        """Replace the newest payload of a state channel."""
        with self._lock:
            before = self._incoming.get(channel.key) or self._newest.get(channel.key)
            self._incoming[channel.key] = (payload, receipt_ns)
            self._arriving.add(channel.key)
            if before is not None and receipt_ns - before[1] > NS_PER_S / channel.rate_hz + LATE_NS:
                self._late[channel.key] = self._late.get(channel.key, 0) + 1

    def late(self, channel: Channel[Any]) -> int:
        """How many messages of a periodic channel came more than 20 ms after they were due."""
        with self._lock:
            return self._late.get(channel.key, 0)

    def malformed_in_a_row(self, channel: Channel[Any]) -> int:
        """How many of the last messages of a state channel that this node looked at could not be decoded."""
        return self._malformed.get(channel.key, 0)

    def put_request(self, channel: Channel[Any], request: Received[Any]) -> bool:
        """Append a request; false, and it is not kept, if too many wait. Urgent ones have places of their own."""
        most = REQUEST_BACKLOG + (URGENT_BACKLOG if getattr(request.message, "urgent", False) else 0)
        with self._lock:
            queue = self._queues.setdefault(channel.key, deque())
            if len(queue) >= most:
                return False
            queue.append(request)
        return True

    def put_answer(self, channel: Channel[Any], payload: bytes, receipt_ns: int) -> None:
        """Append the answer to one of this node's own requests on the channel; a malformed one is dropped."""
        with suppress(MessageError):
            self.put_request(channel, self._decode(Answer, channel, payload, receipt_ns))

    def refuse(self, error: MessageError) -> None:
        """Count bytes that were no message; keep the reason for the log."""
        self.malformed += 1
        self.faults.append(str(error))

    def newest(self, channel: Channel[M]) -> Received[M] | None:
        """The newest valid message ever received, of any age."""
        stored = self._newest.get(channel.key)
        if stored is None:
            return None
        payload, receipt_ns = stored
        known = self._decoded.get(channel.key)
        if known is not None and known[0] is payload:
            return cast("Received[M] | None", known[1])
        received: Received[M] | None
        try:
            received = self._decode(channel.message, channel, payload, receipt_ns)
            self._malformed[channel.key] = 0
        except MessageError:
            self._spoilt.add(channel.key)
            self._malformed[channel.key] = self._malformed.get(channel.key, 0) + 1
            received = known[1] if known is not None else None
        self._decoded[channel.key] = (payload, received)
        return received

    def fresh(self, channel: Channel[M], now_ns: int) -> M | None:
        """The newest message if it is younger than the channel's maximum age.

        Within a robot the age counts from the source's stamp, between robots from local receipt. A step begins a
        little before it looks, so that a message may be younger than the step; one from further ahead is not fresh.
        """
        received = self.newest(channel)
        if received is None:
            return None
        since_ns = received.receipt_ns if channel.reach == "pair" else received.header.stamp_ns
        return received.message if -EARLY_NS <= now_ns - since_ns <= channel.max_age_ns else None

    def arrived(self, channel: Channel[M]) -> M | None:
        """The newest message, if it came since the last step and could be decoded."""
        if channel.key not in self._arrived:
            return None
        received = self.newest(channel)
        return received.message if received is not None and channel.key not in self._spoilt else None

    def requests(self, channel: Channel[M]) -> list[Received[M]]:
        """Requests that came since the last step, oldest first."""
        return self._take(channel.key)

    def answers(self, channel: Channel[Any]) -> list[Answer]:
        """Answers to this node's own requests that came since the last step."""
        return [received.message for received in self._take(channel.key)]

    def begin_step(self) -> None:
        """Fix what this step sees: the states received until now. Executors call it before each step."""
        with self._lock:
            incoming, self._incoming = self._incoming, {}
            late = dict(self._late) if self._watch is not None else {}
            self._newest.update(incoming)
            self._arrived, self._arriving = self._arriving, set()
        self._spoilt.clear()
        if self._watch is not None:
            self._watch.states(incoming, late)

    def kept(self) -> tuple[dict[str, tuple[bytes, int]], dict[str, int]]:
        """What it keeps between steps: the newest payload of each state with its receipt, the counts of late ones."""
        with self._lock:
            return dict(self._newest), dict(self._late)

    def put_back(self, newest: Mapping[str, tuple[bytes, int]], late: Mapping[str, int]) -> None:
        """Put back what :meth:`kept` gave, or a part of it."""
        with self._lock:
            self._newest.update({key: (payload, receipt_ns) for key, (payload, receipt_ns) in newest.items()})
            self._late.update(late)

    def _take(self, key: str) -> list[Received[Any]]:
        with self._lock:
            taken = list(self._queues.pop(key, ()))
        if taken and self._watch is not None:
            self._watch.taken(key, taken)
        return taken

    def _decode(
        self, message_type: type[Any], channel: Channel[Any], payload: bytes, receipt_ns: int
    ) -> Received[Any]:
        try:
            header, message = self._decoder(message_type, payload)
            if channel.reach == "robot" and self._boot_id not in (None, header.boot_id):
                raise MessageError(f"{channel.key}: stamped in another boot")
        except MessageError as error:
            self.refuse(error)
            raise
        return Received(message, header, receipt_ns)


class Node(ABC):
    """The work of one process. ``name`` is its name in the process table.

    ``bus_settings`` is None except for the gateways, whose session is a router's.
    """

    name: str
    trigger: Trigger
    bus_settings: Mapping[str, Any] | None = None
    inputs: tuple[Channel[Any], ...] = ()
    outputs: tuple[Channel[Any], ...] = ()
    serves: tuple[Channel[Any], ...] = ()
    overhears: bool = False

    def overhear(self, key: str, payload: bytes, receipt_ns: int) -> None:  # noqa: B027 - for recorders
        """Everything that is published, if the class ``overhears``; from another thread, must return at once."""

    def start(self, now_ns: int) -> None:  # noqa: B027 - a node may have nothing to open
        """Open devices.

        Raises:
            DeviceError: a device is missing or refuses; the text names it.
        """

    @abstractmethod
    def step(self, now_ns: int, inputs: Inbox) -> Sequence[Output]:
        """Do one step and return what to publish, requests and answers included."""

    def stop(self, now_ns: int) -> Sequence[Output]:  # noqa: ARG002 - overridden where time matters
        """Bring devices into a safe state; also called after a failed step."""
        return ()


class Outbox:
    """Gives a process's messages their headers: source, run, sequence per channel, stamp."""

    def __init__(self, source: str, run_id: int, boot_id: str) -> None:
        self._source, self._run_id, self._boot_id = source, run_id, boot_id
        self._sequences: dict[str, int] = {}

    def pack(self, channel: Channel[Any], message: Message, now_ns: int) -> bytes:
        """The message's bytes as published on the channel now."""
        sequence = self._sequences.get(channel.key, 0) + 1
        self._sequences[channel.key] = sequence
        return encode(message, Header(self._source, self._run_id, sequence, now_ns, self._boot_id))

    def sequence(self, channel: Channel[Any]) -> int:
        """Of the last message packed for the channel."""
        return self._sequences.get(channel.key, 0)
