"""The gateways' settings as generated: what the table says, and nothing that Zenoh has switched on by itself."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from common.channels import CHANNELS, FOLLOWER_SUMMARY, LEADER_STATE, LED_REQUEST, LOCK_REQUEST
from common.config import Config, NetworkConfig, load_config
from common.errors import ConfigError
from gateway.access import OTHER, Robot, exports, robot_access
from gateway.node import robot_router, site_router
from station.cli import app
from tests.rigs.canbus_rig import CONFIG_PATH

ROBOTS: tuple[Robot, ...] = tuple(OTHER)


def allowed(access: dict[str, Any], party: str) -> set[tuple[str, str, str]]:
    """Every (flow, message, key) that a party may."""
    (policy,) = [policy for policy in access["policies"] if policy["subjects"] == [party]]
    rules = {rule["id"]: rule for rule in access["rules"]}
    assert all(rule["permission"] == "allow" for rule in rules.values())
    return {
        (flow, message, key)
        for identity in policy["rules"]
        for rule in [rules[identity]]
        for flow in rule["flows"]
        for message in rule["messages"]
        for key in rule["key_exprs"]
    }


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_other_robot_may_what_the_channel_table_says(config: Config, robot: Robot) -> None:
    access = robot_access(config.network, robot)
    may = allowed(access, "neighbour")
    home = "davpc/"
    ours, theirs = exports(robot, "davpc"), exports(OTHER[robot], "davpc")
    assert {key for flow, message, key in may if (flow, message) == ("ingress", "put")} == set(theirs.states)
    assert {key for flow, message, key in may if (flow, message) == ("egress", "put")} == set(ours.states)
    assert {key for flow, message, key in may if (flow, message) == ("ingress", "query")} == set(ours.requests)
    assert {key for flow, message, key in may if (flow, message) == ("egress", "query")} == set(theirs.requests)
    assert not [message for _, message, _ in may if message == "delete"]
    stays = {home + channel.key for channel in CHANNELS if channel.reach == "robot"}
    assert stays
    assert not stays & {key for _, _, key in may}
    own = f"davpc/{robot}/gateway/state"
    kept = {entry for entry in allowed(access, "mesh") if entry[2] in stays}
    assert kept == {("egress", "put", own), ("ingress", "declare_subscriber", own)}, "what it tells of itself"
    assert not any("**" in key for _, _, key in may | allowed(access, "mesh"))


def test_the_leaders_state_and_the_lock_are_what_a_docking_needs() -> None:
    assert f"davpc/{LEADER_STATE.key}" in exports("leader", "davpc").states
    assert exports("leader", "davpc").requests == (f"davpc/{LOCK_REQUEST.key}", f"davpc/{LED_REQUEST.key}")
    assert f"davpc/{FOLLOWER_SUMMARY.key}" in exports("follower", "davpc").states
    assert exports("follower", "davpc").requests == ()


def test_the_guide_names_what_crosses() -> None:
    guide = (CONFIG_PATH.parents[2] / "docs/network.md").read_text()
    assert all(f"`{channel.key}`" in guide for channel in CHANNELS if channel.reach == "pair")


@pytest.mark.parametrize("robot", ROBOTS)
def test_everything_that_is_not_said_is_denied_and_off(config: Config, robot: Robot) -> None:
    settings = robot_router(config.network, robot, Path("/run/davpc")).settings()
    assert settings["access_control"]["enabled"] is True
    assert settings["access_control"]["default_permission"] == "deny"
    assert settings["adminspace"] == {"enabled": False}
    assert settings["scouting"] == {"multicast": {"enabled": False}, "gossip": {"enabled": False}}
    transport = settings["transport"]
    assert transport["shared_memory"] == {"enabled": False}
    assert transport["link"]["protocols"] == ["unixsock-stream", "quic"]
    assert transport["link"]["tls"]["enable_mtls"] is True
    assert transport["link"]["tls"]["verify_name_on_connect"] is True
    assert transport["link"]["rx"]["max_message_size"] == config.network.max_message_bytes
    subjects = {subject["id"]: subject for subject in settings["access_control"]["subjects"]}
    certificate = {"follower": "leader", "leader": "follower"}[robot]
    assert subjects["neighbour"]["cert_common_names"] == [certificate]
    assert set(subjects) == {"mesh", "neighbour"}


def test_an_operator_watches_and_neither_publishes_nor_asks() -> None:
    network = NetworkConfig(operators=("operator",))
    may = allowed(robot_access(network, "follower"), "operator")
    assert {message for flow, message, _ in may if flow == "ingress"} == {
        "declare_subscriber",
        "liveliness_query",
        "declare_liveliness_subscriber",
    }
    assert ("egress", "put", f"davpc/{LEADER_STATE.key}") in may


def of_site(name: str, **changes: Any) -> NetworkConfig:
    """A pair that goes through the router of a site."""
    table = {
        "namespace": f"hall/{name}",
        "follower": {"certificate": f"{name}-follower"},
        "leader": {"certificate": f"{name}-leader"},
        "site_router": "site",
        **changes,
    }
    return NetworkConfig.model_validate(table)


def test_a_site_router_keeps_pairs_apart() -> None:
    settings = site_router([of_site("a"), of_site("b")], "site", Path("pki"), ["quic/0.0.0.0:7447"]).settings()
    subjects = [subject["cert_common_names"] for subject in settings["access_control"]["subjects"]]
    assert subjects == [["a-follower"], ["a-leader"], ["b-follower"], ["b-leader"]]
    for name in ("a", "b"):
        for robot in ROBOTS:
            keys = {key for _, _, key in allowed(settings["access_control"], f"hall/{name}-{robot}")}
            assert keys
            assert all(key.startswith(f"hall/{name}/") for key in keys)
    assert settings["transport"]["link"]["protocols"] == ["quic"]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"namespace": "hall/a"}, "namespace 'hall/a' belongs to two"),
        ({"leader": {"certificate": "a-follower"}}, "certificate 'a-follower' belongs to two"),
        ({"site_router": "another"}, "pair 'hall/b' names 'another' instead"),
    ],
)
def test_pairs_that_a_site_router_cannot_tell_apart_are_refused(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        site_router([of_site("a"), of_site("b", **changes)], "site", Path("pki"), ["quic/0.0.0.0:7447"])


def test_the_command_line_shows_the_settings_that_the_gateway_opens_with(config: Config) -> None:
    arguments = ["network", "settings", "leader", "--config", str(CONFIG_PATH), "--runtime", "/run/davpc"]
    shown = CliRunner().invoke(app, arguments)
    assert json.loads(shown.output) == robot_router(config.network, "leader", Path("/run/davpc")).settings()
    refused = CliRunner().invoke(app, ["network", "settings", "station"])
    assert str(refused.exception) == "no robot 'station'; there are: follower, leader"


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ('network.follower.listen=["tcp/0.0.0.0:7447"]', "network.follower.listen.0"),
        ('network.namespace="two words"', "network.namespace"),
        ('network.leader.certificate="follower"', "certificate 'follower' is given twice"),
        ('network.operators=["leader"]', "certificate 'leader' is given twice"),
    ],
)
def test_a_mistake_in_the_network_table_is_named(setting: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        load_config(CONFIG_PATH, [setting])
