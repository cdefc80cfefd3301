"""What each party may send and receive on the network: Zenoh's access control, derived from the channel table.

Only these leave a robot: channels whose reach in :mod:`common.channels` is the pair, the health of its processes and
their liveliness, each from the robot of its publisher and in that direction only. Everything else is denied to all,
so that motion keys do not even reach the gateway.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from common.channels import CHANNELS, LIVE_KEYS, Channel, health_channel, live_key
from common.config import NetworkConfig
from common.processes import GATEWAYS, PROCESSES

Robot = Literal["follower", "leader"]
OTHER: Mapping[Robot, Robot] = {"follower": "leader", "leader": "follower"}


@dataclass(frozen=True)
class Exports:
    """Keys that one robot offers to others: states it publishes, requests it answers, tokens of its processes."""

    states: tuple[str, ...]
    requests: tuple[str, ...]
    tokens: tuple[str, ...]

    @property
    def keys(self) -> tuple[str, ...]:
        """All of them."""
        return (*self.states, *self.requests, *self.tokens)


def crossing(robot: Robot) -> list[Channel[Any]]:
    """The channels that leave this robot, health included."""
    names = [entry.name for entry in PROCESSES if entry.robot == robot]
    channels = [*CHANNELS, *map(health_channel, names)]
    return [channel for channel in channels if channel.reach == "pair" and channel.publisher in names]


def exports(robot: Robot, namespace: str) -> Exports:
    """The keys, as on the wire, that leave this robot."""
    channels = crossing(robot)
    names = [entry.name for entry in PROCESSES if entry.robot == robot]
    return Exports(
        tuple(f"{namespace}/{channel.key}" for channel in channels if channel.kind == "state"),
        tuple(f"{namespace}/{channel.key}" for channel in channels if channel.kind == "request"),
        tuple(f"{namespace}/{live_key(name)}" for name in names),
    )


_Rule = dict[str, Any]


def _rule(identity: str, flow: str, messages: Sequence[str], keys: Iterable[str]) -> list[_Rule]:
    chosen = list(keys)
    if not chosen:
        return []
    return [{"id": identity, "permission": "allow", "flows": [flow], "messages": list(messages), "key_exprs": chosen}]


def _offers(party: str, flow: str, offered: Exports) -> list[_Rule]:
    """Rules for sending ``offered`` through ``flow``."""
    name = f"{party}-{flow}"
    return [
        *_rule(f"{name}-state", flow, ["put"], offered.states),
        *_rule(f"{name}-answers", flow, ["reply", "declare_queryable"], offered.requests),
        *_rule(f"{name}-tokens", flow, ["liveliness_token"], offered.tokens),
    ]


def _wants(party: str, flow: str, wanted: Exports, namespace: str) -> list[_Rule]:
    """Rules for requesting ``wanted`` through ``flow``."""
    name = f"{party}-{flow}-wanted"
    alive = ["liveliness_query", "declare_liveliness_subscriber"]
    return [
        *_rule(f"{name}-state", flow, ["declare_subscriber"], wanted.states),
        *_rule(f"{name}-requests", flow, ["query"], wanted.requests),
        *_rule(f"{name}-tokens", flow, alive, [*wanted.tokens, f"{namespace}/{LIVE_KEYS}"]),
    ]


def party_rules(party: str, ours: Exports, theirs: Exports, namespace: str) -> list[_Rule]:
    """Rules towards a party that offers ``theirs`` and may receive ``ours``.

    Args:
        party: its name in the rules' identities.
        ours, theirs: keys that each side offers, with the namespace.
        namespace: of the pair.
    """
    return [
        *_offers(party, "ingress", theirs),
        *_offers(party, "egress", ours),
        *_wants(party, "ingress", ours, namespace),
        *_wants(party, "egress", theirs, namespace),
    ]


def _access(parties: Mapping[str, tuple[dict[str, Any], list[_Rule]]]) -> dict[str, Any]:
    """Zenoh access control: default deny, and one policy for each party of (its identity, its rules)."""
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [rule for _, rules in parties.values() for rule in rules],
        "subjects": [{"id": party, **who} for party, (who, _) in parties.items()],
        "policies": [
            {"rules": [rule["id"] for rule in rules], "subjects": [party]} for party, (_, rules) in parties.items()
        ],
    }


def _certified(names: Sequence[str]) -> dict[str, Any]:
    return {"link_protocols": ["quic"], "cert_common_names": list(names)}


def _own_state(robot: Robot, namespace: str) -> list[_Rule]:
    """Rules for the gateway's own state, which only the processes of its robot receive."""
    keys = [f"{namespace}/{channel.key}" for channel in CHANNELS if channel.publisher == GATEWAYS[robot]]
    return [
        *_rule("mesh-gateway-state", "egress", ["put"], keys),
        *_rule("mesh-gateway-wanted", "ingress", ["declare_subscriber"], keys),
    ]


def robot_access(network: NetworkConfig, robot: Robot) -> dict[str, Any]:
    """Access control of a robot's gateway."""
    space = network.namespace
    ours, theirs = exports(robot, space), exports(OTHER[robot], space)
    both = Exports(ours.states + theirs.states, ours.requests + theirs.requests, ours.tokens + theirs.tokens)
    neighbour = network.site_router or network.of(OTHER[robot]).certificate
    parties = {
        "mesh": (
            {"link_protocols": ["unixsock-stream"]},
            [*party_rules("mesh", both, both, space), *_own_state(robot, space)],
        ),
        "neighbour": (_certified([neighbour]), party_rules("neighbour", ours, theirs, space)),
    }
    if network.operators:
        seen = Exports(both.states, (), both.tokens)
        nothing = Exports((), (), ())
        watching = [
            *_offers("operator", "egress", seen),
            *_wants("operator", "ingress", seen, space),
            *_wants("operator", "egress", nothing, space),
        ]
        parties["operator"] = (_certified(network.operators), watching)
    return _access(parties)


def rules_digest(access: Mapping[str, Any]) -> str:
    """Short hash of access rules, to compare a gateway's rules with those of a configuration."""
    return hashlib.sha256(json.dumps(access, sort_keys=True).encode()).hexdigest()[:16]


def site_access(pairs: Sequence[NetworkConfig]) -> dict[str, Any]:
    """Access control of a site's router: each robot reaches only the other robot of its pair."""
    parties = {}
    for network in pairs:
        space = network.namespace
        for robot, other in OTHER.items():
            party = f"{space}-{robot}"
            rules = party_rules(party, exports(other, space), exports(robot, space), space)
            parties[party] = (_certified([network.of(robot).certificate]), rules)
    return _access(parties)
