"""A robot's gateway: a router, the only process with a network socket. It passes on what the channel table allows.

:mod:`gateway.access` derives the access rules; here are the other settings of the router, and the process.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from common.bus import explicit_links
from common.channels import FOLLOWER_GATEWAY, LEADER_GATEWAY, Channel, health_channel
from common.config import NetworkConfig
from common.errors import ConfigError
from common.messages import GatewayState
from common.node import Inbox, Node, NodeContext, Output, Trigger
from common.processes import GATEWAYS, PROCESSES
from common.timing import NS_PER_S
from gateway.access import OTHER, Robot, crossing, robot_access, rules_digest, site_access
from gateway.credentials import check_credentials, credentials_folder

_FLOOD_FACTOR = 20.0
_DAY_S = 86_400.0
_WARN_S = 30 * _DAY_S
_log = logging.getLogger("gateway")


@dataclass(frozen=True, kw_only=True)
class Router:
    """Parameters of one router.

    ``certificate`` is the common name, ``folder`` holds the files; ``listen`` and ``connect`` are Zenoh addresses;
    ``rates_hz`` are the rates of keys from the network.
    """

    certificate: str
    folder: Path
    listen: tuple[str, ...]
    connect: tuple[str, ...]
    access: dict[str, Any]
    rates_hz: dict[str, float]
    max_message_bytes: int

    def settings(self) -> dict[str, Any]:
        """Zenoh settings.

        Mutual TLS over QUIC, which unlike TCP detects a dead link within the lease; no admin space, no scouting, no
        compression, no shared memory; messages that are too big or too frequent are dropped on arrival.
        """
        addresses = (*self.listen, *self.connect)
        return {
            "mode": "router",
            "listen": {"endpoints": list(self.listen), "exit_on_failure": True},
            **explicit_links(self.connect),
            "transport": {
                "shared_memory": {"enabled": False},
                "unicast": {"max_sessions": 64, "accept_pending": 32, "open_timeout": 2000, "accept_timeout": 2000},
                "link": {
                    "protocols": list(dict.fromkeys(address.partition("/")[0] for address in addresses)),
                    "tx": {"lease": 2000, "keep_alive": 4},
                    "rx": {"max_message_size": self.max_message_bytes},
                    "tls": self._tls(),
                },
            },
            "access_control": self.access,
            "downsampling": [self._flood_limit()],
        }

    def _tls(self) -> dict[str, Any]:
        certificate, key = (str(self.folder / f"{self.certificate}.{kind}") for kind in ("pem", "key"))
        return {
            "root_ca_certificate": str(self.folder / "ca.pem"),
            "enable_mtls": True,
            "verify_name_on_connect": True,
            "close_link_on_expiration": True,
            "listen_certificate": certificate,
            "listen_private_key": key,
            "connect_certificate": certificate,
            "connect_private_key": key,
        }

    def _flood_limit(self) -> dict[str, Any]:
        """Accept at most twenty times a channel's rate from the network."""
        return {
            "id": "flood",
            "messages": ["put"],
            "flows": ["ingress"],
            "link_protocols": ["quic"],
            "rules": [{"key_expr": key, "freq": _FLOOD_FACTOR * rate} for key, rate in self.rates_hz.items()],
        }


def _rates_hz(network: NetworkConfig, robots: Iterable[Robot]) -> dict[str, float]:
    states = [channel for robot in robots for channel in crossing(robot) if channel.kind == "state"]
    return {f"{network.namespace}/{channel.key}": channel.rate_hz for channel in states}


def robot_router(network: NetworkConfig, robot: Robot, runtime: Path) -> Router:
    """The router of a robot's gateway: Unix sockets to its own processes, QUIC to the network."""
    name, party = GATEWAYS[robot], network.of(robot)
    peers = [entry.name for entry in PROCESSES if entry.robot == robot and entry.name != name]
    return Router(
        certificate=party.certificate,
        folder=credentials_folder(network.credentials),
        listen=(f"unixsock-stream/{runtime / name}.sock", *party.listen),
        connect=(*(f"unixsock-stream/{runtime / peer}.sock" for peer in peers), *party.connect),
        access=robot_access(network, robot),
        rates_hz=_rates_hz(network, [OTHER[robot]]),
        max_message_bytes=network.max_message_bytes,
    )


def site_router(pairs: Sequence[NetworkConfig], certificate: str, folder: Path, listen: Sequence[str]) -> Router:
    """The router of a site, to which the robots of several pairs connect; each robot reaches only its own pair.

    Args:
        pairs: the network table of each pair.
        certificate: common name of the router's certificate.
        folder: with ``ca.pem`` and the router's certificate and key.
        listen: Zenoh addresses.

    Raises:
        ConfigError: two pairs share a namespace or a certificate, or one does not name this router.
    """
    robots = [pair.of(robot).certificate for pair in pairs for robot in OTHER]
    for what, values in (("namespace", [pair.namespace for pair in pairs]), ("certificate", robots)):
        twice = sorted({value for value in values if values.count(value) > 1})
        if twice:
            raise ConfigError(
                f"network: {what} {twice[0]!r} belongs to two: it must differ between pairs on one site"
            )
    for pair in pairs:
        if pair.site_router != certificate:
            raise ConfigError(f"network.site_router: pair {pair.namespace!r} names {pair.site_router!r} instead")
    rates = {key: rate for pair in pairs for key, rate in _rates_hz(pair, OTHER).items()}
    limit = max(pair.max_message_bytes for pair in pairs)
    return Router(
        certificate=certificate,
        folder=folder,
        listen=tuple(listen),
        connect=(),
        access=site_access(pairs),
        rates_hz=rates,
        max_message_bytes=limit,
    )


class Gateway(Node):
    """A gateway: its session is the router. The node publishes twice a second whether the other robot's gateway is
    reachable, how long the certificate is valid, and the digest of its rules.
    """

    trigger = Trigger(period_ns=NS_PER_S // 2)

    def __init__(self, context: NodeContext, robot: Robot, state: Channel[GatewayState]) -> None:
        """Check the credentials.

        Raises:
            ConfigError: they cannot be used.
        """
        router = robot_router(context.config.network, robot, context.runtime)
        left_s = check_credentials(router.folder, router.certificate)
        if left_s < _WARN_S:
            _log.warning("certificate %s expires in %.1f days", router.certificate, left_s / _DAY_S)
        self._good_until_ns = context.clock.now_ns() + round(left_s * NS_PER_S)
        self._state = state
        self._rules = rules_digest(router.access)
        self._other = health_channel(GATEWAYS[OTHER[robot]])
        self._linked: bool | None = None
        self.inputs = (self._other,)
        self.bus_settings = router.settings()

    def step(self, now_ns: int, inputs: Inbox) -> Sequence[Output]:
        """Publish the state, and log when the link comes or goes."""
        linked = inputs.fresh(self._other, now_ns) is not None
        if linked != self._linked:
            self._linked = linked
            _log.info("%s %s", self._other.publisher, "is reachable" if linked else "is not reachable")
        left_s = (self._good_until_ns - now_ns) / NS_PER_S
        return ((self._state, GatewayState(linked, left_s, self._rules)),)


class FollowerGateway(Gateway):
    """The Follower's gateway."""

    name = GATEWAYS["follower"]
    outputs = (FOLLOWER_GATEWAY,)


class LeaderGateway(Gateway):
    """The Leader's gateway."""

    name = GATEWAYS["leader"]
    outputs = (LEADER_GATEWAY,)


def make_follower(context: NodeContext) -> FollowerGateway:
    """The Follower's gateway process."""
    return FollowerGateway(context, "follower", FOLLOWER_GATEWAY)


def make_leader(context: NodeContext) -> LeaderGateway:
    """The Leader's gateway process."""
    return LeaderGateway(context, "leader", LEADER_GATEWAY)
