"""``davpc network``: the rules that the gateways apply, and the router of a site with several pairs."""

from __future__ import annotations

import json
import signal
from pathlib import Path
from typing import Annotated

import typer

from common.bus import routing
from common.config import load_config
from common.errors import ConfigError
from gateway.access import OTHER
from gateway.credentials import check_credentials
from gateway.node import robot_router, site_router
from station.options import ROBOT, ConfigOption, SetOption, loaded

network = typer.Typer(
    no_args_is_help=True, help="The network between robots: rules, a site's router. `davpc network settings leader`"
)
_STOP = {signal.SIGINT, signal.SIGTERM}


@network.command(epilog="Example:  davpc network settings follower")
def settings(
    robot: Annotated[str, typer.Argument(help="follower or leader")],
    runtime: Annotated[Path, typer.Option(help="folder of the robot's sockets")] = ROBOT,
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Print the Zenoh settings that a robot's gateway generates."""
    for known in OTHER:
        if robot == known:
            typer.echo(
                json.dumps(robot_router(loaded(config, overrides).network, known, runtime).settings(), indent=2)
            )
            return
    raise ConfigError(f"no robot {robot!r}; there are: {', '.join(OTHER)}")


@network.command(epilog="Example:  davpc network site a.toml b.toml --listen quic/0.0.0.0:7447 --credentials pki")
def site(
    pairs: Annotated[list[Path], typer.Argument(help="robots.toml of each pair")],
    listen: Annotated[str, typer.Option(help="address for the robots to connect to")] = "quic/0.0.0.0:7447",
    certificate: Annotated[str, typer.Option(help="common name of the router's certificate")] = "site",
    credentials: Annotated[Path, typer.Option(help="folder of ca.pem, NAME.pem, NAME.key")] = Path("/etc/davpc/pki"),
) -> None:
    """Run the router that several pairs share, until SIGTERM."""
    router = site_router([load_config(path).network for path in pairs], certificate, credentials, [listen])
    check_credentials(credentials, certificate)
    signal.pthread_sigmask(signal.SIG_BLOCK, _STOP)
    with routing(router.settings()):
        typer.echo(f"routing for {len(pairs)} pairs on {listen}")
        signal.sigwait(_STOP)
