"""Whoever is not the other robot gets nothing through a gateway: 0 of 100, beside 100 of 100 of the right one."""

from __future__ import annotations

import random
import socket
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import pytest
import zenoh

from common.bus import Bus
from common.channels import CHANNELS, COMMAND, LEADER_STATE, LOCK_REQUEST
from common.messages import Command, Header, encode, seal_command
from common.processes import process
from gateway.access import OTHER
from tests.net.gateways import READY_S, Gateways, Recorder, authority, needs_openssl, published_until
from tests.net.rogue import connected, expired, first_packets, resident_mb
from tests.rigs.waiting import until

pytestmark = [pytest.mark.alone, needs_openssl]
MESSAGES = 100
SPACE = "davpc"
STATES = [channel for channel in CHANNELS if channel.kind == "state"]
KEYS = [channel.key for channel in STATES]
NOT_THE_FOLLOWERS = [channel.key for channel in STATES if process(channel.publisher).robot != "follower"]
NOT_THE_LEADERS = [channel.key for channel in STATES if process(channel.publisher).robot != "leader"]


class Site:
    """The pair under attack: who listens within the Follower, and the right Leader to compare with."""

    def __init__(self, gateways: Gateways) -> None:
        self.gateways = gateways
        self.follower: Bus = gateways.play("follower-supervisor")
        self.leader: Bus = gateways.play("leader")
        self.heard = Recorder(self.follower, *STATES)
        self.served: list[bytes] = []
        self.leader.serve(LOCK_REQUEST, self._serve)
        self._right = 0
        published_until(lambda: self.leader.publish(LEADER_STATE, b"hello"), lambda: self.heard.of(LEADER_STATE))

    def _serve(self, asked: bytes, answer: object) -> None:
        self.served.append(asked)
        answer(b"locked")  # type: ignore[operator]

    def endpoint(self, robot: str, protocol: str = "quic") -> str:
        """Where a robot's gateway listens."""
        return f"{protocol}/127.0.0.1:{self.gateways.ports[robot]}"  # type: ignore[index]

    def right_one(self, session: zenoh.Session) -> None:
        """One message by the Leader's certificate; fails unless it is received."""
        self._right += 1
        payload = b"right %d" % self._right
        self.sure(lambda: session.put(LEADER_STATE.key, payload), payload)

    def sure(self, publish: Callable[[], None], payload: bytes) -> None:
        """Publish a Leader's state until it is received; again only if it came too close to another for the rate."""
        again_s = 0.0

        def heard() -> bool:
            nonlocal again_s
            if time.monotonic() >= again_s:
                publish()
                again_s = time.monotonic() + 0.1
            return payload in self.heard.of(LEADER_STATE)

        until(heard, READY_S)

    def accepted(self) -> list[bytes]:
        """Payloads of rogues that came through so far."""
        return [payload for key in self.heard.payloads.values() for payload in key if payload.startswith(b"rogue")]


@pytest.fixture(scope="module")
def site(gateways: Gateways) -> Site:
    return Site(gateways)


@pytest.fixture(scope="module")
def controller(gateways: Gateways) -> Bus:
    """The Follower's controller, whose commands must get to where they should and nowhere else."""
    return gateways.play("follower-controller")


@pytest.fixture
def right(site: Site, certificates: Path) -> Iterator[zenoh.Session]:
    """The Leader's certificate: 100 of 100 come through beside any rogue's none."""
    with connected(site.endpoint("follower"), certificates / "ca.pem", certificates / "leader", SPACE) as session:
        published_until(
            lambda: session.put(LEADER_STATE.key, b"first"), lambda: b"first" in site.heard.of(LEADER_STATE)
        )
        yield session


@pytest.mark.parametrize("kind", ["no certificate", "other authority", "expired", "plain tcp"])
def test_who_cannot_show_a_certificate_of_the_authority_is_not_let_in(
    kind: str, site: Site, right: zenoh.Session, certificates: Path, tmp_path: Path
) -> None:
    shown: Path | None = certificates / "leader"
    if kind == "no certificate":
        shown = None
    elif kind == "other authority":
        shown = authority(tmp_path / "other", "leader") / "leader"
    elif kind == "expired":
        shown = expired(certificates, "leader", tmp_path / "expired")
    protocol = "tcp" if kind == "plain tcp" else "quic"

    def intrude(robot: str) -> int:
        inside = 0
        for number in range(MESSAGES // 2):
            try:
                with connected(site.endpoint(robot, protocol), certificates / "ca.pem", shown, SPACE) as session:
                    inside += 1
                    session.put(LEADER_STATE.key, b"rogue %d" % number)
                    session.put(COMMAND.key, b"rogue %d" % number)
            except zenoh.ZError:
                continue
        return inside

    with ThreadPoolExecutor() as pool:
        assert list(pool.map(intrude, OTHER)) == [0, 0]
    for _ in range(MESSAGES):
        site.right_one(right)
    assert site.accepted() == []


@pytest.mark.parametrize(
    ("shown", "door", "keys"),
    [
        ("guest", "follower", KEYS),
        ("operator", "follower", KEYS),
        ("leader", "follower", NOT_THE_LEADERS),
        ("follower", "follower", KEYS),
        ("guest", "leader", KEYS),
        ("follower", "leader", NOT_THE_FOLLOWERS),
    ],
)
def test_a_certificate_gives_its_own_rights_and_no_others(
    shown: str, door: str, keys: list[str], site: Site, right: zenoh.Session, certificates: Path
) -> None:
    leader_heard = Recorder(site.leader, *STATES)
    with connected(site.endpoint(door), certificates / "ca.pem", certificates / shown, SPACE) as session:
        for number in range(MESSAGES):
            for key in keys:
                session.put(key, b"rogue %d" % number)
                session.put(f"elsewhere/{key}", b"rogue %d" % number)
            site.right_one(right)
        if (shown, door) != ("follower", "leader"):
            assert not list(session.get(LOCK_REQUEST.key, payload=b"rogue", timeout=1.0))
    assert site.accepted() == []
    assert not [p for key in leader_heard.payloads.values() for p in key if p.startswith(b"rogue")]
    assert b"rogue" not in site.served


def test_recorded_commands_do_not_come_back_by_the_leaders_certificate(
    site: Site, right: zenoh.Session, controller: Bus
) -> None:
    commands = [seal_command(Command(0.3, 0.1, 1, n, n, n + 1, n, n)) for n in range(1, MESSAGES + 1)]
    recorded = [encode(c, Header("follower-controller", 1, c.sequence, 1, "boot")) for c in commands]
    heard = Recorder(site.follower, COMMAND)
    published_until(lambda: controller.publish(COMMAND, b"hello"), lambda: heard.of(COMMAND))
    for payload in recorded:
        controller.publish(COMMAND, payload)
    until(lambda: recorded[-1] in heard.of(COMMAND), READY_S)
    heard.of(COMMAND).clear()
    for payload in recorded:
        right.put(COMMAND.key, payload)
        site.right_one(right)
    assert heard.of(COMMAND) == []


def has(payloads: list[bytes], payload: bytes) -> bool:
    """Whether it came."""
    return payload in payloads


def noting(keys: list[str]) -> Callable[[zenoh.Sample], None]:
    """Notes the key of each sample."""
    return lambda sample: keys.append(str(sample.key_expr))


def test_an_operator_hears_the_pair_and_a_guest_nothing(site: Site, right: zenoh.Session, certificates: Path) -> None:
    heard: dict[str, list[str]] = {"operator": [], "guest": []}
    with ExitStack() as stack:
        for name, keys in heard.items():
            session = stack.enter_context(
                connected(site.endpoint("follower"), certificates / "ca.pem", certificates / name, SPACE)
            )
            for key in (*(channel.key for channel in STATES), "**"):
                session.declare_subscriber(key, noting(keys))
        published_until(lambda: site.right_one(right), lambda: LEADER_STATE.key in heard["operator"])
        for channel in STATES:
            site.follower.publish(channel, b"inside")
        for _ in range(MESSAGES):
            site.right_one(right)
    assert set(heard["operator"]) == {channel.key for channel in STATES if channel.reach == "pair"}
    assert heard["guest"] == []


def test_garbage_and_half_open_connections_touch_neither_link_nor_memory(
    site: Site, gateways: Gateways, controller: Bus, certificates: Path
) -> None:
    chance = random.Random(7)
    packets = first_packets(50, certificates / "ca.pem", certificates / "leader")
    doors = {robot: ("127.0.0.1", port) for robot, port in gateways.ports.items()}
    heard = Recorder(site.follower, COMMAND)
    published_until(lambda: controller.publish(COMMAND, b"hello"), lambda: heard.of(COMMAND))

    def attack(stack: ExitStack, rounds: int) -> None:
        for number in range(rounds):
            for address in doors.values():
                link = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
                packet = bytearray(packets[number % len(packets)])
                link.sendto(packet, address)
                for _ in range(20):
                    packet[chance.randrange(len(packet))] = chance.randrange(256)
                    link.sendto(packet, address)
                    link.sendto(chance.randbytes(chance.randint(1, 1400)), address)
            state = b"%d of %d" % (number, rounds)
            controller.publish(COMMAND, state)
            until(partial(has, heard.of(COMMAND), state), READY_S)
            site.sure(partial(site.leader.publish, LEADER_STATE, state), state)

    with ExitStack() as stack:
        attack(stack, 40)
        before = {robot: resident_mb(child.pid) for robot, child in gateways.running.items()}
        attack(stack, 120)
        grown = {robot: resident_mb(child.pid) - before[robot] for robot, child in gateways.running.items()}
    assert all(megabytes <= 5.0 for megabytes in grown.values()), grown
    assert all(child.poll() is None for child in gateways.running.values())
