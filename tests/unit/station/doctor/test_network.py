"""Findings about the robots' network."""

from __future__ import annotations

import copy
from typing import Any

from common.config import Config
from common.messages import GatewayState
from gateway.access import robot_access, rules_digest
from station.doctor.findings import (
    Finding,
    ProbeResult,
)
from station.doctor.network import check_access, check_certificate, check_link
from tests.rigs.station_rig import found

DAY_S = 86_400.0


def test_certificates() -> None:
    found(check_certificate("follower", ProbeResult(200 * DAY_S)), "ok", "200.0 days")
    found(check_certificate("follower", ProbeResult(20 * DAY_S)), "warning", "deploy/pki.sh renew follower")
    found(check_certificate("follower", ProbeResult(0.5 * DAY_S)), "failed", "0.5 days")
    found(
        check_certificate("follower", ProbeResult(why="follower.key: others may read it")),
        "failed",
        "others may read",
    )


def test_access_rules(config: Config) -> None:
    generated = robot_access(config.network, "follower")

    def check(rules: dict[str, Any], running: GatewayState | None) -> Finding:
        return check_access("follower", rules, config.network.namespace, running)

    found(check(generated, None), "ok", "no gateway runs")
    found(check(generated, GatewayState(True, 1e6, rules_digest(generated))), "ok", "as the gateway applies them")
    other = robot_access(config.network.model_copy(update={"namespace": "elsewhere"}), "follower")
    found(check(generated, GatewayState(True, 1e6, rules_digest(other))), "failed", "restart davpc-follower-gateway")
    leaking = copy.deepcopy(generated)
    leaking["rules"].append({"id": "leak", "key_exprs": ["davpc/follower/motion/command"]})
    policies = {policy["subjects"][0]: policy for policy in leaking["policies"]}
    policies["neighbour"]["rules"].append("leak")
    found(check(leaking, None), "failed", "davpc/follower/motion/command")
    found(check({**generated, "default_permission": "allow"}, None), "failed", "deny by default")
    found(check({**generated, "enabled": False}, None), "failed", "not enabled")


def test_link() -> None:
    found(check_link("follower", GatewayState(True, 1e6, "")), "ok")
    found(check_link("follower", GatewayState(False, 1e6, "")), "warning", "nothing of the other")
    found(check_link("follower", None), "skipped")
