"""Checks of the network between the robots: certificates, access rules, link."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from common.channels import CHANNELS
from common.messages import GatewayState
from gateway.access import rules_digest
from station.doctor.findings import Finding, ProbeResult, failed, ok, skipped, warning

_DAY_S = 86_400.0
_WARN_DAYS = 30


def check_certificate(name: str, left_s: ProbeResult[float]) -> Finding:
    """For how long a certificate is still good; under a day a robot does not arm (docs/safety.md S45)."""
    check = f"certificate {name}"
    if left_s.value is None:
        return failed(check, left_s.why, "deploy/pki.sh issue, then into network.credentials")
    days = left_s.value / _DAY_S
    text = f"good for {days:.1f} days"
    if days < 1.0:
        return failed(check, text, f"deploy/pki.sh renew {name}, put it in place, restart the gateway")
    if days < _WARN_DAYS:
        return warning(check, text, f"deploy/pki.sh renew {name}")
    return ok(check, text)


def check_access(robot: str, generated: Mapping[str, Any], namespace: str, running: GatewayState | None) -> Finding:
    """The rules that the configuration gives: none lets a robot's own keys out; and the gateway applies them.

    Args:
        robot: whose gateway.
        generated: access control as Zenoh takes it.
        namespace: of the pair.
        running: what the gateway reports; None if none runs.
    """
    check = f"access rules {robot}"
    private = {f"{namespace}/{channel.key}" for channel in CHANNELS if channel.reach == "robot"}
    leaks = sorted(private & _outside(generated))
    if leaks or not generated["enabled"] or generated["default_permission"] != "deny":
        seen = f"let out {', '.join(leaks)}" if leaks else "not enabled, or not deny by default"
        return failed(check, seen, "stop the gateway: this davpc is not as it was released")
    digest = rules_digest(generated)
    if running is None:
        return ok(check, f"{len(generated['rules'])} rules ({digest}), deny by default; no gateway runs to compare")
    if running.rules != digest:
        return failed(
            check,
            f"the gateway applies {running.rules}, the configuration gives {digest}",
            f"the configuration changed since it started: systemctl restart davpc-{robot}-gateway",
        )
    return ok(check, f"{len(generated['rules'])} rules ({digest}), deny by default, as the gateway applies them")


def _outside(generated: Mapping[str, Any]) -> set[str]:
    """Keys that any rule gives to a subject outside this robot's own mesh of Unix sockets."""
    mesh = {subject["id"] for subject in generated["subjects"] if subject["link_protocols"] == ["unixsock-stream"]}
    outside = [policy for policy in generated["policies"] if not set(policy["subjects"]) <= mesh]
    rules = {identity for policy in outside for identity in policy["rules"]}
    return {key for rule in generated["rules"] if rule["id"] in rules for key in rule["key_exprs"]}


def check_link(robot: str, running: GatewayState | None) -> Finding:
    """Whether a robot's gateway receives the other robot's messages."""
    check = f"link {robot}"
    if running is None:
        return skipped(check, "no gateway runs here")
    if not running.linked:
        return warning(
            check, "nothing of the other robot is received", "addresses in [network], firewall, the other's gateway"
        )
    return ok(check, "the other robot is connected")
