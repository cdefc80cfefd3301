"""``davpc wiring``: what to wire, and which node ids to set, from the configuration."""

from __future__ import annotations

import typer

from station.commission import wiring as tables
from station.options import ConfigOption, SetOption, loaded

wire = typer.Typer()


@wire.command(epilog="Example:  davpc wiring --config /etc/davpc/robots.toml")
def wiring(config: ConfigOption = None, overrides: SetOption = None) -> None:
    """Print what to wire and which node ids to set, from the configuration. `davpc wiring`"""
    typer.echo(tables.wiring(loaded(config, overrides)))
