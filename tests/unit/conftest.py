"""What several unit tests share: the reference robots."""

from __future__ import annotations

from pathlib import Path

import pytest

from common.config import Config, load_config

REFERENCE = Path(__file__).resolve().parents[2] / "deploy/config/robots.toml"


@pytest.fixture(scope="session")
def config() -> Config:
    """The reference pair of robots."""
    return load_config(REFERENCE)
