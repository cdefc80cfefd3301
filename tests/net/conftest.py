"""Certificates of the tests' own authority, and a linked pair of gateways."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.net.gateways import Gateways, authority


@pytest.fixture(scope="session")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An authority with all who have a place on the network, and a guest who has none."""
    return authority(tmp_path_factory.mktemp("pki") / "pki", "follower", "leader", "operator", "guest", "site")


@pytest.fixture(scope="module")
def gateways(certificates: Path) -> Iterator[Gateways]:
    """A linked pair for the tests of a module."""
    pair = Gateways(certificates)
    try:
        yield pair.linked()
    finally:
        pair.close()
