"""Which method ``controller.method`` names. Only the chosen one's module is imported."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module

from common.config import Config
from common.errors import ConfigError
from follower.controller.interface import DockingMethod

MODULES = {
    "davpc": "follower.controller.davpc",
    "paper_fatrop": "follower.paper.method",
    "paper_ipopt": "follower.paper.method",
}


def make_method(config: Config) -> DockingMethod:
    """The method that ``controller.method`` names, by its module's ``make``.

    Raises:
        ConfigError: there is no such method.
    """
    name = config.controller.method
    if name not in MODULES:
        raise ConfigError(f"controller.method: {name!r} is none of {', '.join(MODULES)}")
    make: Callable[[Config], DockingMethod] = import_module(MODULES[name]).make
    return make(config)
