"""Loads, each the endless work of one process: it says that it is ready, waits for the start, and is killed."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import socket
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

from common.bus import Bus, explicit_links
from common.channels import CHANNELS, LEADER_STATE
from common.errors import DeviceError
from common.executor import earlier_processes
from common.timing import MonotonicClock
from experiments.fuzz.messages import Mutator
from experiments.fuzz.mutate import spoilt

SUBSCRIBERS, SESSIONS = 200, 8
_READY_S = 180.0
_BLOCK_BYTES, _BLOCKS = 1 << 20, 64
_PAYLOADS = 500
_DATAGRAM_BYTES = 1400
_SPAWN = multiprocessing.get_context("spawn")
Start = Callable[[], None]


@dataclass(frozen=True, kw_only=True)
class Site:
    """Where the robots are, for those who load them.

    Attributes:
        runtime: private directory of the Follower's processes.
        namespace: of the pair's keys.
        ports: on which the gateways listen.
        credentials: folder of certificates.
        disk: folder to write to.
    """

    runtime: Path
    namespace: str
    ports: Mapping[str, int]
    credentials: Path
    disk: Path


def burn(_site: Site, start: Start) -> None:
    """Keep a core busy."""
    start()
    number = 0
    while True:
        number += 1


def write(site: Site, start: Start) -> None:
    """Write blocks, each flushed to the disk; no more than 64 MB stay there."""
    path = site.disk / f"load-{os.getpid()}.bin"
    block = os.urandom(_BLOCK_BYTES)
    with path.open("wb") as file:
        path.unlink()  # whatever becomes of this process, nothing stays
        start()
        while True:
            for _ in range(_BLOCKS):
                file.write(block)
                file.flush()
                os.fsync(file.fileno())
            file.seek(0)


def stranger(site: Site, start: Start) -> None:
    """On the robots' network, with a certificate that the pair does not name: anything, on every key."""
    with _on_network(site, "stranger") as bus:
        random = Random(1)
        mutator = Mutator(random, MonotonicClock().boot_id)
        payloads = [(channel, mutator.payload(channel, 0)) for channel in CHANNELS for _ in range(30)]
        start()
        while True:
            bus.publish(*random.choice(payloads))


def impostor(site: Site, start: Start) -> None:
    """With a copy of the Leader's certificate: what is no message, on the key of its state."""
    with _on_network(site, "leader") as bus:
        random = Random(2)
        mutator = Mutator(random)
        payloads = [spoilt(random, mutator.payload(LEADER_STATE, 0))[:60_000] for _ in range(_PAYLOADS)]
        start()
        while True:
            bus.publish(LEADER_STATE, random.choice(payloads))


def knock(site: Site, start: Start) -> None:
    """Datagrams and TCP connections to the ports of both gateways."""
    random = Random(3)
    packets = [random.randbytes(random.randint(1, _DATAGRAM_BYTES)) for _ in range(_PAYLOADS)]
    start()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as door:
        for number in iter(int, 1):
            for port in site.ports.values():
                for _ in range(50):
                    with suppress(OSError):
                        door.sendto(random.choice(packets), ("127.0.0.1", port))
                with suppress(OSError), socket.create_connection(("127.0.0.1", port), 0.1) as link:
                    link.sendall(packets[number])


def subscribe(site: Site, start: Start) -> None:
    """Two hundred subscribers to the Follower's channels, in its own mesh, as tools and recorders make them."""
    states = [channel for channel in CHANNELS if channel.kind == "state"]
    peers = earlier_processes("station")
    with contextlib.ExitStack() as stack:
        for number in range(SESSIONS):
            name = f"watcher-{os.getpid()}-{number}"
            bus = stack.enter_context(Bus(name, site.runtime, peers, site.namespace))
            for place in range(SUBSCRIBERS // SESSIONS):
                bus.subscribe(states[place % len(states)], _ignore)
        start()
        multiprocessing.Event().wait()


def _ignore(_payload: bytes) -> None:
    """A subscriber reads, and does nothing."""


@contextmanager
def under(work: Sequence[Callable[[Site, Start], None]], site: Site) -> Iterator[None]:
    """While processes do this work: entered once all are ready and started together; left when all are gone.

    Raises:
        DeviceError: one of them could not begin.
    """
    ready, go = _SPAWN.Semaphore(0), _SPAWN.Event()
    children = [_SPAWN.Process(target=_process, args=(each, site, ready, go), daemon=True) for each in work]
    try:
        for child in children:
            child.start()
        for child in children:
            if not ready.acquire(timeout=_READY_S):
                raise DeviceError(f"a load did not begin in {_READY_S:.0f} s: {child.name}")
        go.set()
        yield
    finally:
        for child in children:
            if child.pid is not None:
                child.kill()
                child.join()


def _process(work: Callable[[Site, Start], None], site: Site, ready: Any, go: Any) -> None:
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))

    def start() -> None:
        ready.release()
        go.wait()

    work(site, start)


@contextmanager
def _on_network(site: Site, certificate: str) -> Iterator[Bus]:
    """A session of a client at the Follower's gateway."""
    files = {kind: str(site.credentials / f"{certificate}.{kind}") for kind in ("pem", "key")}
    tls = {
        "root_ca_certificate": str(site.credentials / "ca.pem"),
        "verify_name_on_connect": True,
        "enable_mtls": True,
        "connect_certificate": files["pem"],
        "connect_private_key": files["key"],
    }
    settings = {
        "mode": "client",
        **explicit_links([f"quic/127.0.0.1:{site.ports['follower']}"]),
        "transport": {"shared_memory": {"enabled": False}, "link": {"tls": tls}},
    }
    with (
        tempfile.TemporaryDirectory(prefix="davpc-") as folder,
        Bus("stranger", Path(folder), [], site.namespace, settings) as bus,
    ):
        yield bus
