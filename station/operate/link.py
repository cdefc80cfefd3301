"""A person's requests to running robots, real or simulated: find them, ask, listen."""

from __future__ import annotations

import contextlib
import fcntl
import os
import secrets
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any, TypeVar

from common.bus import Bus
from common.channels import Channel
from common.errors import DeviceError
from common.executor import earlier_processes
from common.messages import Answer, Message, MessageError, decode
from common.node import Outbox
from common.timing import NS_PER_S, MonotonicClock

M = TypeVar("M", bound=Message)
_ROBOT = Path("/run/davpc")
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
    if any(_ROBOT.glob("*.sock")):
        return _ROBOT
    parents = dict.fromkeys((Path("/dev/shm"), Path("/run/shm"), Path(tempfile.gettempdir())))
    found = [path for parent in parents for path in parent.glob(_SIMULATED) if _in_use(path)]
    if not found:
        raise DeviceError("no robot runs here: start one (davpc sim), or name its folder with --runtime")
    if len(found) > 1:
        raise DeviceError(f"{len(found)} simulated pairs run here: name one with --runtime {found[0]}")
    return found[0]


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
    """Connection of one command; a context manager that leaves nothing behind. Many may be open at once."""

    def __init__(self, runtime: Path, namespace: str) -> None:
        self._clock = MonotonicClock()
        self._runtime = runtime
        self._name = f"person-{os.getpid()}"
        self._outbox = Outbox(self._name, secrets.randbits(62), self._clock.boot_id)
        self._bus = Bus(self._name, runtime, earlier_processes(self._name), namespace)

    def __enter__(self) -> RobotLink:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bus.close()
        for path in self._runtime.glob(f"{self._name}.*"):
            path.unlink(missing_ok=True)

    @property
    def now_ns(self) -> int:
        """The clock that requests expire by."""
        return self._clock.now_ns()

    def ask(self, channel: Channel[Any], request: Any, patience_s: float) -> Answer:
        """Ask until somebody answers; the same id, so that it is carried out once.

        Raises:
            DeviceError: nobody answered in time.
        """
        end_ns = self._clock.now_ns() + round(patience_s * NS_PER_S)
        while self._clock.now_ns() < end_ns:
            payload = self._outbox.pack(channel, request, self._clock.now_ns())
            reply = self._bus.request(channel, payload, min(_ANSWER_S, patience_s))
            if reply is not None:
                try:
                    return decode(Answer, reply)[1]
                except MessageError as error:
                    raise DeviceError(f"{channel.publisher}: {error}: is it of another version?") from error
            self.pause(_RETRY_S)
        raise DeviceError(f"{channel.publisher} does not answer: does it run?")

    def pause(self, seconds: float) -> None:
        """Wait a little."""
        self._clock.sleep_until(self._clock.now_ns() + round(seconds * NS_PER_S))

    def watch(self, *channels: Channel[Any]) -> Watch:
        """Hear these channels from now on."""
        return Watch(self._bus, channels)


class Watch:
    """The newest message of each of some channels."""

    def __init__(self, bus: Bus, channels: tuple[Channel[Any], ...]) -> None:
        self._heard: dict[str, Any] = {}
        self._count = len(channels)
        self._news = threading.Condition()
        for channel in channels:
            bus.subscribe(channel, self._receiver(channel))

    def wait(self, patience_s: float) -> bool:
        """Until something of every channel has come; whether it did in time."""
        with self._news:
            return self._news.wait_for(lambda: len(self._heard) == self._count, patience_s)

    def newest(self, channel: Channel[M]) -> M | None:
        """The newest message, None if none has come."""
        with self._news:
            found: M | None = self._heard.get(channel.key)
        return found

    def forget(self) -> None:
        """As if nothing had come yet."""
        with self._news:
            self._heard.clear()

    def _receiver(self, channel: Channel[Any]) -> Callable[[bytes], None]:
        def receive(payload: bytes) -> None:
            with contextlib.suppress(MessageError):  # of another version: as if nothing had come
                message = decode(channel.message, payload)[1]
                with self._news:
                    self._heard[channel.key] = message
                    self._news.notify_all()

        return receive
