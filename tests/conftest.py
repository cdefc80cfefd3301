"""What all tests share: the reference configuration and a settled Hypothesis profile."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from common.config import Config, load_config

REFERENCE = Path(__file__).parent.parent / "deploy/config/robots.toml"

settings.register_profile("davpc", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("davpc")


@pytest.fixture(scope="session")
def config() -> Config:
    """The reference robots."""
    return load_config(REFERENCE)


@pytest.fixture(scope="session")
def config_path() -> Path:
    """Where the reference robots are written down."""
    return REFERENCE
