"""The network between the robots."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from common.config.section import Section

DEFAULT_NAMESPACE = "davpc"
CertificateName = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9.-]{0,62}$")]
NetworkAddress = Annotated[str, Field(pattern=r"^quic/(\[[0-9a-f:]+\]|[A-Za-z0-9.-]+):[0-9]{1,5}$")]


class GatewayConfig(Section):
    """One robot's gateway: common name of its certificate, addresses as ``quic/host:port``."""

    certificate: CertificateName
    listen: tuple[NetworkAddress, ...] = ()
    connect: tuple[NetworkAddress, ...] = ()


class NetworkConfig(Section):
    """The network between the robots, and the certificates that their gateways accept.

    ``namespace`` separates this pair from others on the site's network. ``credentials`` is a folder with ``ca.pem``
    and, for each certificate, ``NAME.pem`` and ``NAME.key``. ``site_router`` is the certificate of a router, if both
    robots connect to one instead of to each other. Certificates in ``operators`` may watch, but change nothing.
    """

    namespace: Annotated[str, Field(pattern=r"^[a-z0-9_-]+(/[a-z0-9_-]+)*$")] = DEFAULT_NAMESPACE
    credentials: str = "/etc/davpc/pki"
    max_message_bytes: Annotated[int, Field(ge=4096, le=1_048_576)] = 65_536
    follower: GatewayConfig = GatewayConfig(
        certificate="follower", listen=("quic/0.0.0.0:7447",), connect=("quic/leader:7447",)
    )
    leader: GatewayConfig = GatewayConfig(
        certificate="leader", listen=("quic/0.0.0.0:7447",), connect=("quic/follower:7447",)
    )
    site_router: CertificateName | None = None
    operators: tuple[CertificateName, ...] = ()

    def of(self, robot: Literal["follower", "leader"]) -> GatewayConfig:
        """The gateway of one robot."""
        return self.follower if robot == "follower" else self.leader

    @model_validator(mode="after")
    def _names_differ(self) -> NetworkConfig:
        names = [self.follower.certificate, self.leader.certificate, *self.operators]
        names += [self.site_router] if self.site_router else []
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"certificate {twice[0]!r} is given twice: each needs its own")
        return self
