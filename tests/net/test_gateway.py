"""What crosses between two robots through their gateways: the channel table says it, nothing else does."""

from __future__ import annotations

from typing import Any

import pytest

from common.bus import Bus
from common.channels import (
    CHANNELS,
    COMMAND,
    DOCK_REQUEST,
    LEADER_STATE,
    LOCK_REQUEST,
    MISSION,
    Channel,
    health_channel,
)
from common.processes import GATEWAYS, PROCESSES, process
from gateway.access import OTHER, Robot
from tests.net.gateways import READY_S, Gateways, Recorder, needs_openssl, published_until
from tests.rigs.waiting import until

pytestmark = [pytest.mark.alone, needs_openssl]
Players = dict[Robot, Bus]


@pytest.fixture(scope="module")
def players(gateways: Gateways) -> Players:
    """One process of each robot; it may publish and hear anything within its robot."""
    players: Players = {"follower": gateways.play("follower-supervisor"), "leader": gateways.play("leader")}
    for name, robot in (("follower-supervisor", "follower"), ("leader", "leader")):
        players[robot].declare_alive(name)  # type: ignore[index]
    until(lambda: "leader" in players["follower"].alive(), READY_S)
    return players


def test_states_cross_if_and_only_if_their_channel_leaves_the_robot(players: Players) -> None:
    states: list[Channel[Any]] = [channel for channel in CHANNELS if channel.kind == "state"]
    states += [health_channel(entry.name) for entry in PROCESSES if entry.name not in GATEWAYS.values()]
    heard = {robot: Recorder(bus, *states) for robot, bus in players.items()}

    def publish() -> None:
        for channel in states:
            for robot, bus in players.items():
                bus.publish(channel, f"from {robot}".encode())

    def crossed() -> set[tuple[str, Robot]]:
        return {
            (channel.key, robot)
            for channel in states
            for robot in players
            if f"from {OTHER[robot]}".encode() in heard[robot].of(channel)
        }

    wanted = {
        (channel.key, OTHER[home])
        for channel in states
        for home in OTHER
        if channel.reach == "pair" and process(channel.publisher).robot == home
    }
    assert ("leader/state", "follower") in wanted
    published_until(publish, lambda: crossed() >= wanted)
    assert crossed() == wanted


def test_requests_are_answered_across_if_and_only_if_their_channel_leaves_the_robot(players: Players) -> None:
    follower, leader = players["follower"], players["leader"]
    leader.serve(LOCK_REQUEST, lambda asked, answer: answer(asked + b": locked"))
    follower.serve(DOCK_REQUEST, lambda asked, answer: answer(asked + b": docking"))
    until(lambda: follower.request(LOCK_REQUEST, b"lock", 1.0) == b"lock: locked", READY_S)
    assert follower.request(DOCK_REQUEST, b"dock", 1.0) == b"dock: docking"
    assert leader.request(DOCK_REQUEST, b"dock", 1.0) is None


def test_each_robot_sees_the_others_processes_alive(players: Players) -> None:
    everybody = {"follower-supervisor", "leader", *GATEWAYS.values()}
    for bus in players.values():
        until(lambda bus=bus: bus.alive() == everybody, READY_S)


def test_what_stays_in_the_robot_comes_once_beside_a_gateway(gateways: Gateways, players: Players) -> None:
    bridge = gateways.play("follower-can-bridge")
    heard = Recorder(bridge, MISSION, LEADER_STATE)
    published_until(lambda: players["follower"].publish(MISSION, b"hello"), lambda: heard.of(MISSION))
    published_until(lambda: players["leader"].publish(LEADER_STATE, b"hello"), lambda: heard.of(LEADER_STATE))
    for number in range(100):
        players["follower"].publish(MISSION, b"%d" % number)
    until(lambda: b"99" in heard.of(MISSION), READY_S)
    assert [payload for payload in heard.of(MISSION) if payload != b"hello"] == [b"%d" % n for n in range(100)]


def test_big_messages_and_floods_are_dropped_and_the_link_stays(gateways: Gateways, players: Players) -> None:
    heard = Recorder(players["follower"], LEADER_STATE)
    players["leader"].publish(LEADER_STATE, bytes(200_000))
    flood = 5000
    for _ in range(flood):
        players["leader"].publish(LEADER_STATE, b"flood")
    published_until(
        lambda: players["leader"].publish(LEADER_STATE, b"after"), lambda: b"after" in heard.of(LEADER_STATE)
    )
    assert max(map(len, heard.of(LEADER_STATE))) < 200_000
    assert heard.of(LEADER_STATE).count(b"flood") < flood / 20
    assert gateways.log("follower").count("is reachable") == 1


def test_a_killed_gateway_leaves_the_robot_at_work_and_links_again(gateways: Gateways, players: Players) -> None:
    controller = gateways.play("follower-controller")
    heard = Recorder(players["follower"], COMMAND, LEADER_STATE)
    published_until(lambda: controller.publish(COMMAND, b"hello"), lambda: heard.of(COMMAND))
    heard.of(COMMAND).clear()
    gateways.running["follower"].kill()
    gateways.running["follower"].wait()
    for number in range(200):
        controller.publish(COMMAND, b"%d" % number)
    until(lambda: b"199" in heard.of(COMMAND), READY_S)
    assert heard.of(COMMAND)[-200:] == [b"%d" % number for number in range(200)]
    until(lambda: "follower-gateway is not reachable" in gateways.log("leader").split("is reachable")[-1], READY_S)
    gateways.start("follower")
    published_until(
        lambda: players["leader"].publish(LEADER_STATE, b"again"), lambda: b"again" in heard.of(LEADER_STATE)
    )
