"""What all tests share: the reference configuration and a settled Hypothesis profile."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from common.config import Config, load_config
from tests.rigs.canbus_rig import CONFIG_PATH
from tests.rigs.sim_run import SimRuns

settings.register_profile("davpc", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("davpc")


@pytest.fixture(scope="session")
def config() -> Config:
    """The reference robots."""
    return load_config(CONFIG_PATH)


@pytest.fixture(scope="session")
def config_path() -> Path:
    """Where the reference robots are written down."""
    return CONFIG_PATH


@pytest.fixture
def sim_run(tmp_path: Path) -> Iterator[SimRuns]:
    """Starts runs and leaves none behind."""
    runs = SimRuns(tmp_path)
    yield runs
    runs.stop()
