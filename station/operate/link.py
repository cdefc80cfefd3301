"""The station's connection to running robots, real or simulated: find them, ask, publish, receive."""

from __future__ import annotations

import fcntl
import os
import queue
import secrets
import tempfile
import threading
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Self, TypeVar

from common.bus import Bus
from common.channels import Channel
from common.errors import DeviceError
from common.executor import earlier_processes
from common.messages import Answer, Header, Message, MessageError, decode
from common.node import Inbox, Outbox
from common.timing import NS_PER_S, Clock, MonotonicClock
from station.options import ROBOT

M = TypeVar("M", bound=Message)
_SIMULATED = "davpc-sim-*"
_ANSWER_S = 1.0
_RETRY_S = 0.1


def running_robot(runtime: Path | None) -> Path:
    """The folder of the robot that runs here: as named, else the installed robot's, else the only simulated pair's.

    Raises:
        DeviceError: none runs here, or several.
    """
    if runtime is not None:
        if any(runtime.glob("*.sock")):
            return runtime
        raise DeviceError(f"{runtime}: no robot runs here")
    if any(ROBOT.glob("*.sock")):
        return ROBOT
    parents = {path.resolve() for path in (Path("/dev/shm"), Path("/run/shm"), Path(tempfile.gettempdir()))}
    found = [path for parent in sorted(parents) for path in parent.glob(_SIMULATED) if _in_use(path)]
    if not found:
        raise DeviceError("no robot runs here: start one (davpc sim), or name its folder with --runtime")
    if len(found) > 1:
        raise DeviceError(
            f"{len(found)} simulated pairs run here: name one with --runtime: {', '.join(map(str, found))}"
        )
    return found[0]


def running_or_installed(runtime: Path | None) -> Path:
    """The folder of the robot that runs here; the installed robot's where none does."""
    if runtime is not None:
        return runtime
    try:
        return running_robot(None)
    except DeviceError:
        return ROBOT


def _in_use(path: Path) -> bool:
    """Whether the launcher that made the folder still holds it; one that was killed leaves its folder behind."""
    try:
        with (path / "owner.lock").open("r") as owner:
            fcntl.flock(owner, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return any(path.glob("*.sock"))
    except OSError:
        return False
    return False


class RobotLink:
    """Connection of one command to running robots: ask, publish, watch, stream; a context manager.

    Many may be open at once, except of one ``name``.

    Args:
        runtime: folder of the running robot's sockets.
        namespace: of the pair.
        name: of this end, where the robot's processes go by it; else one that no other command has, and whose files
            are removed at the end.

    Raises:
        ConfigError: see :class:`common.bus.Bus`.
    """

    def __init__(self, runtime: Path, namespace: str, name: str = "") -> None:
        self.clock = MonotonicClock()
        self._runtime = runtime
        self._own_name = "" if name else f"station-{os.getpid()}"
        used = name or self._own_name
        self._outbox = Outbox(used, secrets.randbits(62), self.clock.boot_id)
        self._bus = Bus(used, runtime, earlier_processes(used), namespace)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._bus.close()
        if self._own_name:
            for path in self._runtime.glob(f"{self._own_name}.*"):
                path.unlink(missing_ok=True)

    @property
    def now_ns(self) -> int:
        """The clock that requests expire by."""
        return self.clock.now_ns()

    def alive(self) -> set[str]:
        """Names of the processes that show that they live."""
        return self._bus.alive()

    def publish(self, channel: Channel[M], message: M) -> None:
        """Publish a message, stamped now."""
        self._bus.publish(channel, self._outbox.pack(channel, message, self.now_ns))

    def ask(self, channel: Channel[Any], request: Any, patience_s: float) -> Answer:
        """Repeat a request until it is answered; its id stays the same, so that it is carried out once.

        Args:
            channel: of the request.
            request: with its id and expiry.
            patience_s: how long to repeat it [s].

        Raises:
            DeviceError: no answer in time, or one that cannot be decoded.
        """
        end_ns = self.now_ns + round(patience_s * NS_PER_S)
        while self.now_ns < end_ns:
            answer = self.ask_once(channel, request, min(_ANSWER_S, patience_s))
            if answer is not None:
                return answer
            self.pause(_RETRY_S)
        raise DeviceError(f"{channel.publisher} does not answer: does it run?")

    def ask_once(self, channel: Channel[Any], request: Any, patience_s: float = _ANSWER_S) -> Answer | None:
        """Ask once; None without an answer in time. The request may still be carried out after that.

        Raises:
            DeviceError: the answer cannot be decoded.
        """
        reply = self._bus.request(channel, self._outbox.pack(channel, request, self.now_ns), patience_s)
        try:
            return None if reply is None else decode(Answer, reply)[1]
        except MessageError as error:
            raise DeviceError(f"{channel.publisher}: {error}: is it of another version?") from error

    def pause(self, seconds: float) -> None:
        """Wait a little."""
        self.clock.sleep_until(self.now_ns + round(seconds * NS_PER_S))

    def watch(self, *channels: Channel[Any]) -> Watch:
        """The newest message of each of these channels, from now on."""
        return Watch(self._bus, self.clock, channels)

    def overhear(self, take: Callable[[str, bytes, int], None]) -> None:
        """Hand on key, payload and time of receipt of everything that is published, from now on."""
        self._bus.overhear(lambda key, payload: take(key, payload, self.now_ns))

    def stream(self, *channels: Channel[Any]) -> Stream:
        """Every message of these channels, from now on."""
        return Stream(self._bus, channels)


class Watch:
    """The newest message of each of some channels; one that cannot be decoded counts as none."""

    def __init__(self, bus: Bus, clock: Clock, channels: Sequence[Channel[Any]]) -> None:
        self._clock, self._channels = clock, channels
        self._inbox = Inbox(None)  # containers hide the boot's id from a command that enters them
        self._news = threading.Condition()
        for channel in channels:
            bus.subscribe(channel, partial(self._put, channel))

    def wait(self, patience_s: float) -> bool:
        """Until every channel has brought a message; whether it did in time."""
        with self._news:
            return self._news.wait_for(lambda: None not in map(self.newest, self._channels), patience_s)

    def newest(self, channel: Channel[M]) -> M | None:
        """The newest message, None if none has come."""
        self._inbox.begin_step()
        received = self._inbox.newest(channel)
        return None if received is None else received.message

    def fresh(self, channel: Channel[M]) -> M | None:
        """The newest message, None if it is older than its channel allows."""
        self._inbox.begin_step()
        return self._inbox.fresh(channel, self._clock.now_ns())

    def forget(self) -> None:
        """Drop what has come."""
        self._inbox = Inbox(None)

    def _put(self, channel: Channel[Any], payload: bytes) -> None:
        self._inbox.put_state(channel, payload, self._clock.now_ns())
        with self._news:
            self._news.notify_all()


class Stream:
    """Every message of some channels, in the order in which they came."""

    def __init__(self, bus: Bus, channels: Sequence[Channel[Any]]) -> None:
        self._waiting: queue.SimpleQueue[tuple[Channel[Any], bytes]] = queue.SimpleQueue()
        for channel in channels:
            bus.stream(channel, partial(self._put, channel))

    def next(self, patience_s: float) -> tuple[Channel[Any], Header, Any] | None:
        """The next message with its channel and header; None if none comes in time.

        Raises:
            MessageError: it cannot be decoded; names its channel.
        """
        try:
            channel, payload = self._waiting.get(timeout=patience_s)
        except queue.Empty:
            return None
        try:
            return channel, *decode(channel.message, payload)
        except MessageError as error:
            raise MessageError(f"{channel.key}: {error}") from error

    def _put(self, channel: Channel[Any], payload: bytes) -> None:
        self._waiting.put((channel, payload))
