"""The only file that imports Zenoh: publish, subscribe to newest values, serve and request over Unix sockets.

Every process listens on its own socket in a private runtime directory and connects to the processes before it in the
process table: no TCP, no scouting, no gossip. Images do not cross the bus, see :mod:`common.frames.ring`.
"""

from __future__ import annotations

import fcntl
import json
import os
import stat
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import IO, Any

import zenoh

from common.channels import LIVE_KEYS, Channel, live_key
from common.config import DEFAULT_NAMESPACE
from common.errors import ConfigError

OnPayload = Callable[[bytes], None]
OnRequest = Callable[[bytes, Callable[[bytes], None]], None]
_RETRY = {"period_init_ms": 50, "period_max_ms": 200, "period_increase_factor": 2}
_SOCKET_PATH_LIMIT = 107
_LOOK_S = 0.005


class Bus:
    """One Zenoh session, as a context manager.

    Args:
        name: of this process; its socket is ``<name>.sock``.
        runtime: private directory (mode 0700) with the sockets of all processes.
        peers: names of the processes to connect to.
        namespace: prefix of every key on the wire, so that several pairs of robots can share a network.
        settings: Zenoh settings instead of those of a peer in the mesh; for the gateways, see :mod:`gateway.node`.

    Raises:
        ConfigError: a path is too long, a process of this name already runs, or an address cannot be used.
    """

    def __init__(
        self,
        name: str,
        runtime: Path,
        peers: Sequence[str],
        namespace: str = DEFAULT_NAMESPACE,
        settings: Mapping[str, Any] | None = None,
    ) -> None:
        sockets = {peer: str(runtime / f"{peer}.sock") for peer in (name, *peers)}
        longest = max(sockets.values(), key=len)
        if len(longest) > _SOCKET_PATH_LIMIT:
            raise ConfigError(f"{longest}: too long for a Unix socket; choose a shorter runtime directory")
        self._owner = _lock_file(runtime, name)
        try:
            fcntl.flock(self._owner, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            self._owner.close()
            raise ConfigError(f"{runtime}: a process {name} already runs here") from error
        Path(sockets[name]).unlink(missing_ok=True)
        Path(sockets[name] + ".lock").unlink(missing_ok=True)
        # a router logs an error for each declaration that its access list refused
        zenoh.init_log_from_env_or("error,zenoh::net::routing=off" if settings else "error")
        self._threads: list[threading.Thread] = []
        self._closing = threading.Event()
        self._declared: list[Any] = []
        self._publishers: dict[str, Any] = {}
        chosen = {
            **(settings or peer_settings(sockets[name], [sockets[peer] for peer in peers])),
            "namespace": namespace,
        }
        try:
            self._session = _opened(name, chosen)
        except ConfigError:
            self._owner.close()
            raise

    def __enter__(self) -> Bus:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def publish(self, channel: Channel[Any], payload: bytes) -> None:
        """Publish; a sample is dropped if a subscriber cannot keep up."""
        publisher = self._publishers.get(channel.key)
        if publisher is None:
            publisher = self._session.declare_publisher(
                channel.key,
                priority=zenoh.Priority.DATA if channel.max_age_ms > 400 else zenoh.Priority.REAL_TIME,
                congestion_control=zenoh.CongestionControl.DROP,
            )
            self._publishers[channel.key] = publisher
        publisher.put(payload)

    def subscribe(self, channel: Channel[Any], on_payload: OnPayload) -> None:
        """Call back with the newest payload of a channel, from a thread of its own; older ones are overwritten."""
        subscriber = self._session.declare_subscriber(channel.key, zenoh.handlers.RingChannel(1))
        self._declared.append(subscriber)
        self._spawn(channel.key, lambda: _drain(subscriber, on_payload))

    def stream(self, channel: Channel[Any], on_payload: OnPayload) -> None:
        """Call back with every payload of a channel, in order, for recording; up to 1000 may wait."""
        subscriber = self._session.declare_subscriber(channel.key, zenoh.handlers.FifoChannel(1000))
        self._declared.append(subscriber)
        self._spawn(channel.key, lambda: _drain(subscriber, on_payload))

    def overhear(self, on_sample: Callable[[str, bytes], None]) -> None:
        """Call back with key and payload of everything that is published, in order, from one thread.

        It looks every 5 ms: to be woken by each of 600 messages a second would cost twice the computing time.
        """
        subscriber = self._session.declare_subscriber("**", zenoh.handlers.FifoChannel(4000))
        self._declared.append(subscriber)

        def drain() -> None:
            with suppress(zenoh.ZError):  # undeclared meanwhile
                while not self._closing.wait(_LOOK_S):
                    while (sample := subscriber.try_recv()) is not None:
                        on_sample(str(sample.key_expr), sample.payload.to_bytes())

        self._spawn("**", drain)

    def serve(self, channel: Channel[Any], on_request: OnRequest) -> None:
        """Call back with each request and a function that answers it, from a thread of its own."""
        queryable = self._session.declare_queryable(channel.key, zenoh.handlers.FifoChannel(64))
        self._declared.append(queryable)
        self._spawn(channel.key, lambda: _serve(queryable, channel.key, on_request))

    def request(self, channel: Channel[Any], payload: bytes, timeout_s: float) -> bytes | None:
        """Send a request and wait; None if no answer came in time. The request may still be carried out later."""
        for reply in self._session.get(channel.key, payload=payload, timeout=timeout_s):
            if reply.ok is not None:
                return reply.ok.payload.to_bytes()
        return None

    def declare_alive(self, process: str) -> None:
        """Declare this process alive to the others, until its session ends."""
        self._declared.append(self._session.liveliness().declare_token(live_key(process)))

    def alive(self) -> set[str]:
        """Names of the processes that are declared alive."""
        replies = self._session.liveliness().get(LIVE_KEYS, timeout=1.0)
        return {str(reply.ok.key_expr).rsplit("/", 1)[-1] for reply in replies if reply.ok is not None}

    def close(self) -> None:
        """Undeclare everything and end the session and its threads."""
        if self._closing.is_set():
            return
        self._closing.set()
        for declared in (*self._declared, *self._publishers.values()):
            declared.undeclare()
        self._session.close()  # type: ignore[no-untyped-call]
        for thread in self._threads:
            thread.join(timeout=2.0)
        self._owner.close()

    def _spawn(self, name: str, work: Callable[[], None]) -> None:
        thread = threading.Thread(target=work, name=name, daemon=True)
        self._threads.append(thread)
        thread.start()


def _lock_file(runtime: Path, name: str) -> IO[bytes]:
    """The file whose lock says that the process runs; never one that a link leads elsewhere to.

    Raises:
        ConfigError: the directory is missing or others may write into it, or the file cannot be opened.
    """
    try:
        folder = runtime.stat()
        if stat.S_IMODE(folder.st_mode) & 0o022 or (folder.st_uid not in (os.geteuid(), 0) and os.geteuid() != 0):
            raise ConfigError(f"{runtime}: others may write here; a runtime directory has mode 0700 and is one's own")
        flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC
        return os.fdopen(os.open(runtime / f"{name}.owner", flags, 0o600), "r+b")
    except OSError as error:
        raise ConfigError(f"{error.filename or runtime}: cannot be opened: {error.strerror}") from error


def _drain(subscriber: Any, on_payload: OnPayload) -> None:
    for sample in subscriber:
        on_payload(sample.payload.to_bytes())


def _serve(queryable: Any, key: str, on_request: OnRequest) -> None:
    for query in queryable:
        payload = query.payload
        if payload is None:
            query.drop()
            continue

        def answer(reply: bytes, query: Any = query) -> None:
            query.reply(key, reply)
            query.drop()

        on_request(payload.to_bytes(), answer)


def explicit_links(connect: Sequence[str]) -> dict[str, Any]:
    """Settings that mesh and gateway share: named peers are retried without end, no peer is discovered."""
    return {
        "connect": {"endpoints": list(connect), "timeout_ms": -1, "exit_on_failure": False, "retry": _RETRY},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "timestamping": {"enabled": False},
        "adminspace": {"enabled": False},
    }


def peer_settings(listen: str, connect: Sequence[str]) -> dict[str, Any]:
    """Zenoh settings of a process in a robot's mesh: it listens on one Unix socket and connects to others."""
    return {
        "mode": "peer",
        "listen": {"endpoints": [f"unixsock-stream/{listen}"]},
        **explicit_links([f"unixsock-stream/{path}" for path in connect]),
        "transport": {
            "shared_memory": {"enabled": False},
            "unicast": {"open_timeout": 500, "accept_timeout": 500},
            "link": {"protocols": ["unixsock-stream"], "tx": {"lease": 500, "keep_alive": 4}},
        },
    }


@contextmanager
def routing(settings: Mapping[str, Any]) -> Iterator[None]:
    """Run a router that belongs to no robot, as a context manager.

    Raises:
        ConfigError: an address that cannot be used.
    """
    zenoh.init_log_from_env_or("error")
    with _opened("router", settings):
        yield


def _opened(name: str, settings: Mapping[str, Any]) -> zenoh.Session:
    try:
        return zenoh.open(zenoh.Config.from_json5(json.dumps(settings)))
    except zenoh.ZError as error:
        # the message without the positions in Zenoh's source
        raise ConfigError(f"{name}: {str(error).split(' at ')[0].strip()}") from error
